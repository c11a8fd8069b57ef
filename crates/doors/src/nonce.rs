//! Session numbers that nobody can guess.

/// A number that tells one session from every other, never zero, from the kernel's generator (getrandom(2)).
pub fn draw_nonce() -> u64 {
    loop {
        let mut bytes = [0; 8];
        // Neither short nor interrupted for so few bytes once the machine has started; otherwise drawn again.
        let drawn = rustix::rand::getrandom(&mut bytes, rustix::rand::GetRandomFlags::empty());
        let nonce = u64::from_ne_bytes(bytes);
        if drawn == Ok(bytes.len()) && nonce != 0 {
            return nonce;
        }
    }
}
