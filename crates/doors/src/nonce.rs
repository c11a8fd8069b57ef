//! Session numbers that no client can guess.

/// Draws a session number from the kernel's generator (getrandom(2)). It is unique among sessions, and never
/// zero.
pub fn draw_nonce() -> u64 {
    loop {
        let mut bytes = [0; 8];
        // For so few bytes the call is neither short nor interrupted once the machine has started. Otherwise draw
        // again.
        let drawn = rustix::rand::getrandom(&mut bytes, rustix::rand::GetRandomFlags::empty());
        let nonce = u64::from_ne_bytes(bytes);
        if drawn == Ok(bytes.len()) && nonce != 0 {
            return nonce;
        }
    }
}
