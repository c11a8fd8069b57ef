//! Bytes on a socket: the fields of a message in their order, little-endian, without padding. On the machines
//! that teleopd runs on, that is the memory layout of the message.

/// One field list for writing and reading, so that the two cannot differ in order.
pub trait Fields {
    /// Transfers the next four bytes.
    fn u32(&mut self, value: &mut u32);
    /// Transfers the next eight bytes.
    fn u64(&mut self, value: &mut u64);

    /// Transfers the next four bytes as a floating-point number.
    fn f32(&mut self, value: &mut f32) {
        let mut bits = value.to_bits();
        self.u32(&mut bits);
        *value = f32::from_bits(bits);
    }

    /// Transfers the next eight bytes as a floating-point number.
    fn f64(&mut self, value: &mut f64) {
        let mut bits = value.to_bits();
        self.u64(&mut bits);
        *value = f64::from_bits(bits);
    }
}

/// Writes fields into a buffer.
pub struct FieldWriter<'a> {
    bytes: &'a mut [u8],
    at: usize,
}

impl<'a> FieldWriter<'a> {
    /// Begins at the start of `bytes`, which must hold all fields.
    pub fn new(bytes: &'a mut [u8]) -> Self {
        Self { bytes, at: 0 }
    }
}

impl Fields for FieldWriter<'_> {
    fn u32(&mut self, value: &mut u32) {
        self.bytes[self.at..self.at + 4].copy_from_slice(&value.to_le_bytes());
        self.at += 4;
    }

    fn u64(&mut self, value: &mut u64) {
        self.bytes[self.at..self.at + 8].copy_from_slice(&value.to_le_bytes());
        self.at += 8;
    }
}

/// Reads fields from a buffer whose length was checked before.
pub struct FieldReader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> FieldReader<'a> {
    /// Begins at the start of `bytes`, which must hold all fields.
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0 }
    }

    fn next<const N: usize>(&mut self) -> [u8; N] {
        let mut out = [0; N];
        out.copy_from_slice(&self.bytes[self.at..self.at + N]);
        self.at += N;
        out
    }
}

impl Fields for FieldReader<'_> {
    fn u32(&mut self, value: &mut u32) {
        *value = u32::from_le_bytes(self.next());
    }

    fn u64(&mut self, value: &mut u64) {
        *value = u64::from_le_bytes(self.next());
    }
}
