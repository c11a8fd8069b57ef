//! Limits the unpacked size of a recording. It measures each chunk while the file is read, before the chunk is
//! unpacked.

use crate::error::McapError;
use mcap::records::op;

/// Largest chunk, bytes before compression. Our own have 1 MiB. The C++, Rust and ROS 2 writers of MCAP use 768
/// KiB, the Go tools 4 MiB by default. Assumption, with a margin for writers with larger settings.
pub(crate) const CHUNK_BYTES_MAX: u64 = 64 << 20;
/// Bytes that chunks may unpack to for each byte of the file before them, in addition to one largest chunk. A run
/// in virtual time with every message unpacks to 5 times its file, the chunk in which the robot rests to 12
/// times. Assumption: about ten times that. Zeros under zstd unpack to 30,000 times their length.
pub(crate) const RATIO_MAX: u64 = 128;

/// Bytes of opcode and length before every record.
const HEAD: usize = 9;
/// Bytes at the start of a chunk: `HEAD`, its first and last time, and its length before compression.
const CHUNK_HEAD: usize = HEAD + 24;
/// Length of `\x89MCAP0\r\n`.
const MAGIC: u64 = 8;

/// Follows the records of a file from its beginning.
#[derive(Debug)]
pub(crate) struct Meter {
    /// Bytes seen.
    at: u64,
    /// Bytes up to the next record's head.
    skip: u64,
    head: [u8; CHUNK_HEAD],
    known: usize,
    /// Declared unpacked size of all chunks so far. The library never returns more than that.
    declared: u64,
    /// Bytes of records that the library returned.
    came: u64,
}

impl Default for Meter {
    fn default() -> Self {
        Self { at: 0, skip: MAGIC, head: [0; CHUNK_HEAD], known: 0, declared: 0, came: 0 }
    }
}

impl Meter {
    /// Bytes of records that the library returned.
    pub(crate) fn came(&self) -> u64 {
        self.came
    }

    /// Examines the file's next bytes.
    pub(crate) fn see(&mut self, mut bytes: &[u8]) -> Result<(), McapError> {
        while !bytes.is_empty() {
            let wanted = if self.known >= HEAD { CHUNK_HEAD } else { HEAD };
            let part = if self.skip > 0 { self.skip } else { (wanted - self.known) as u64 };
            let (now, later) = bytes.split_at(part.min(bytes.len() as u64) as usize);
            bytes = later;
            self.at += now.len() as u64;
            if self.skip > 0 {
                self.skip -= now.len() as u64;
                continue;
            }
            self.head[self.known..self.known + now.len()].copy_from_slice(now);
            self.known += now.len();
            let chunk = self.head[0] == op::CHUNK;
            if self.known == if chunk { CHUNK_HEAD } else { HEAD } {
                let length = self.number(1);
                self.skip = length.saturating_sub(self.known as u64 - HEAD as u64);
                self.known = 0;
                if chunk {
                    self.chunk(self.at - CHUNK_HEAD as u64, self.number(HEAD + 16))?;
                }
            }
        }
        Ok(())
    }

    /// Counts a record that the library returned, `bytes` long without its head.
    pub(crate) fn comes(&mut self, bytes: usize) -> Result<(), McapError> {
        self.came += (HEAD + bytes) as u64;
        let bound = self.declared.saturating_add(self.at);
        if self.came > bound {
            return Err(McapError::Unpacked { offset: self.at, bytes: self.came, bound });
        }
        Ok(())
    }

    fn chunk(&mut self, offset: u64, bytes: u64) -> Result<(), McapError> {
        if bytes > CHUNK_BYTES_MAX {
            return Err(McapError::Chunk { offset, bytes, bound: CHUNK_BYTES_MAX });
        }
        self.declared += bytes;
        let bound = CHUNK_BYTES_MAX.saturating_add(offset.saturating_mul(RATIO_MAX));
        if self.declared > bound {
            return Err(McapError::Unpacked { offset, bytes: self.declared, bound });
        }
        Ok(())
    }

    fn number(&self, at: usize) -> u64 {
        u64::from_le_bytes(std::array::from_fn(|i| self.head[at + i]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(opcode: u8, body: &[u8]) -> Vec<u8> {
        [&[opcode], &(body.len() as u64).to_le_bytes()[..], body].concat()
    }

    fn chunk(unpacked: u64, packed: usize) -> Vec<u8> {
        let mut body = vec![0; 16];
        body.extend(unpacked.to_le_bytes());
        body.resize(24 + packed, 7);
        record(op::CHUNK, &body)
    }

    #[test]
    fn oversized_chunk_is_refused_for_any_read_size() {
        let before = [vec![0x89; 8], record(op::HEADER, &[1; 100]), record(0x7f, &[])].concat();
        let at = before.len() as u64;
        let largest = [before.clone(), chunk(CHUNK_BYTES_MAX, 1000)].concat();
        let next = largest.len() as u64;
        let larger = [before, chunk(CHUNK_BYTES_MAX + 1, 1000)].concat();
        let room = next * RATIO_MAX;
        let full = [largest.clone(), chunk(room, 9), record(op::MESSAGE, &[])].concat();
        let more = [largest.clone(), chunk(room + 1, 9)].concat();
        let bound = CHUNK_BYTES_MAX + room;
        for (file, expected) in [
            (&largest, Ok(())),
            (&full, Ok(())),
            (&larger, Err(McapError::Chunk { offset: at, bytes: CHUNK_BYTES_MAX + 1, bound: CHUNK_BYTES_MAX })),
            (&more, Err(McapError::Unpacked { offset: next, bytes: bound + 1, bound })),
        ] {
            for piece in [1, 7, 32, 33, 34, file.len()] {
                let mut meter = Meter::default();
                assert_eq!(file.chunks(piece).try_for_each(|bytes| meter.see(bytes)), expected, "pieces of {piece}");
            }
        }
    }

    #[test]
    fn data_beyond_header_size_is_refused() {
        let mut meter = Meter::default();
        let file = [vec![0x89; 8], chunk(50, 100)].concat();
        meter.see(&file).expect("a small chunk");
        let bound = file.len() as u64 + 50;
        meter.comes(bound as usize - HEAD).expect("within the declared size");
        assert_eq!(meter.comes(0), Err(McapError::Unpacked { offset: file.len() as u64, bytes: bound + 9, bound }));
    }
}
