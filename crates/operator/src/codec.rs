//! The bytes on the socket: the fields of the message in their order, little-endian ([`Layout::put`]).

use messages::{
    HOLDS_CLUTCH, HOLDS_ENABLE, HOLDS_RECOVERY, LEAVES_OUT, Layout, Message, OPERATOR_VERSION, OperatorRequest, Status,
    TAKES_OVER,
};

/// Length of a request.
pub const REQUEST_BYTES: usize = size_of::<OperatorRequest>();
/// Length of a status.
pub const STATUS_BYTES: usize = size_of::<Status>();

/// Returns the bytes of a request.
pub fn encode_request(request: &OperatorRequest) -> [u8; REQUEST_BYTES] {
    let mut bytes = [0; REQUEST_BYTES];
    request.write_to(&mut bytes);
    bytes
}

/// Returns the request in `bytes`, or `None` if the length, the version or the level is unknown. `control` checks
/// the payload report, because a wrong one must not hide an emergency stop in the same request.
pub fn decode_request(bytes: &[u8]) -> Option<OperatorRequest> {
    let request = OperatorRequest::from_le_bytes(bytes)?;
    let [left, right] = LEAVES_OUT;
    let level = request.enable_level & !(HOLDS_CLUTCH | TAKES_OVER[0] | TAKES_OVER[1]);
    let known = level <= HOLDS_RECOVERY || [HOLDS_ENABLE | left, HOLDS_ENABLE | right].contains(&level);
    (request.version == OPERATOR_VERSION && known).then_some(request)
}

/// Returns the bytes of a status.
pub fn encode_status(status: &Status) -> [u8; STATUS_BYTES] {
    let mut bytes = [0; STATUS_BYTES];
    status.write_to(&mut bytes);
    bytes
}

/// Returns the status in `bytes`, or `None` if the length is not that of a `Status`.
pub fn decode_status(bytes: &[u8]) -> Option<Status> {
    Status::from_le_bytes(bytes)
}
