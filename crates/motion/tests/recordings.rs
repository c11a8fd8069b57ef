//! Tests recordings that unpack to too much, and merged ones. The tests count bytes, not seconds.

use motion::mcap::{Ending, Reader};
use motion::{McapError, load};
use std::io::Cursor;

/// Zeros in a decompression bomb. Each nine of them form an empty record.
const BOMB_BYTES: u64 = 2 << 30;
const CHUNK_MAX: u64 = 64 << 20;
/// A chunk of whole records, slightly smaller.
const CHUNK: u64 = 56 * 9 * BLOCK;
const RATIO_MAX: u64 = 128;
/// Largest length of a zstd block.
const BLOCK: u64 = 128 << 10;

fn record(opcode: u8, body: &[u8]) -> Vec<u8> {
    [&[opcode], &(body.len() as u64).to_le_bytes()[..], body].concat()
}

/// Encodes `bytes` zeros under zstd, as a repeated byte: four bytes for each block of 128 KiB.
fn zeros(bytes: u64) -> Vec<u8> {
    let mut frame = vec![0x28, 0xb5, 0x2f, 0xfd, 0, 7 << 3];
    let blocks = bytes / BLOCK;
    for n in 1..=blocks {
        let header = (BLOCK as u32) << 3 | 1 << 1 | u32::from(n == blocks);
        frame.extend(&header.to_le_bytes()[..3]);
        frame.push(0);
    }
    frame
}

/// Makes a chunk without a checksum that declares `declared` bytes and holds `bytes`.
fn chunk(declared: u64, bytes: u64) -> Vec<u8> {
    let packed = zeros(bytes);
    let mut body = vec![0; 16];
    body.extend(declared.to_le_bytes());
    body.extend([0; 4]);
    body.extend(4_u32.to_le_bytes());
    body.extend(b"zstd");
    body.extend((packed.len() as u64).to_le_bytes());
    body.extend(packed);
    record(6, &body)
}

fn file(chunks: &[Vec<u8>]) -> Vec<u8> {
    [&b"\x89MCAP0\r\n"[..], &record(1, &[0; 8]), &chunks.concat()].concat()
}

/// Returns the end of reading, and the number of bytes unpacked for it.
fn read(file: &[u8]) -> (Result<Ending, McapError>, u64) {
    let mut reader = match Reader::new(Cursor::new(file), |_| 0) {
        Ok(reader) => reader,
        Err(error) => return (Err(error), 0),
    };
    let end = reader.next_message().map(|message| assert_eq!(message, None));
    (end.map(|()| reader.ending().clone()), reader.unpacked_bytes())
}

#[test]
fn f096_decompression_bomb_is_refused_before_unpacking() {
    let whole = file(&[chunk(BOMB_BYTES, BOMB_BYTES)]);
    assert!(whole.len() < 70_000, "{} bytes", whole.len());
    let lost = "the chunk at byte 25 claims to unpack to 2147483648 bytes, at most 67108864 are read";
    let (outcome, unpacked) = read(&whole);
    assert!(matches!(&outcome, Ok(Ending::BrokenOff(text)) if text.contains(lost)) && unpacked == 0, "{outcome:?}");

    let many = file(&vec![chunk(CHUNK, CHUNK); (BOMB_BYTES / CHUNK) as usize]);
    let outcome = read(&many);
    let bound = CHUNK_MAX + RATIO_MAX * 2025;
    assert!(
        matches!(outcome, (Err(McapError::Unpacked { offset: 2000.., bytes, .. }), 0) if bytes > bound),
        "{outcome:?}"
    );

    // A chunk that declares less than it holds yields only the declared bytes.
    let (outcome, unpacked) = read(&file(&vec![chunk(900, CHUNK); 32]));
    assert!(outcome.is_ok() && unpacked < 100_000, "{outcome:?}, {unpacked} bytes");

    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("bomb.mcap");
    std::fs::write(&path, many).expect("written");
    let error = load(&path).expect_err("a bomb").to_string();
    assert!(error.contains("bomb.mcap: decompresses to ") && error.contains("the limit is 67"), "{error}");
}

/// A merge joins two recordings of the same messages. Its second part may name its channels by numbers of their own.
#[test]
fn copies_in_a_merge_of_several_topics_come_once() {
    let mut merged = Cursor::new(Vec::new());
    let mut writer = mcap::Writer::new(&mut merged).expect("a writer");
    for first in [1, 1, 3] {
        for (id, topic) in [(first, "a"), (first + 1, "b")] {
            let metadata = [("part".to_owned(), first.to_string())].into();
            writer.add_channel_with_id(id, 0, topic, "json", &metadata).expect("a channel");
        }
        for time in 0..3 {
            for channel_id in [first, first + 1] {
                let header =
                    mcap::records::MessageHeader { channel_id, sequence: 7, log_time: time, publish_time: time };
                writer.write_to_known_channel(&header, b"the same").expect("written");
            }
        }
        writer.flush().expect("the end of a chunk");
    }
    writer.finish().expect("the end");
    drop(writer);
    let mut reader = Reader::new(merged, |_| 0).expect("a recording");
    let (mut read, mut times) = (Vec::new(), Vec::new());
    while let Some(message) = reader.next_message().expect("whole") {
        read.push(format!("{}{}", reader.source(message.channel).expect("a source").topic, message.log_time));
        times.push(message.log_time);
    }
    assert!(times.is_sorted(), "{times:?}");
    read.sort();
    assert_eq!(read, ["a0", "a1", "a2", "b0", "b1", "b2"]);
}
