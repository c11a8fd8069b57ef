//! The bytes on the socket: the fields of the message in their order (`doors::Fields`).

use doors::{FieldReader, FieldWriter, Fields};
use messages::{HOLDS_RECOVERY, Header, Layout, OPERATOR_VERSION, OperatorRequest, Stamp, Status, Transition};

/// Length of a request.
pub const REQUEST_BYTES: usize = size_of::<OperatorRequest>();
/// Length of a status.
pub const STATUS_BYTES: usize = size_of::<Status>();

fn request_fields(fields: &mut impl Fields, request: &mut OperatorRequest) {
    let OperatorRequest { version, enable_level, enable_count, release_count, reset_count, estop_count, .. } = request;
    for value in [version, enable_level, enable_count, release_count, reset_count, estop_count] {
        fields.u32(value);
    }
    let OperatorRequest { payload_count, payload_flags, sequence, payload_kg, payload_centre_m, .. } = request;
    fields.u32(payload_count);
    fields.u32(payload_flags);
    fields.u64(sequence);
    fields.f64(payload_kg);
    for value in payload_centre_m {
        fields.f64(value);
    }
}

fn header_fields(fields: &mut impl Fields, header: &mut Header) {
    let Header { sequence, stamp: Stamp(stamp), origin: Stamp(origin), config_hash, incarnation, reserved } = header;
    for value in [sequence, stamp, origin, config_hash] {
        fields.u64(value);
    }
    fields.u32(incarnation);
    fields.u32(reserved);
}

fn transition_fields(fields: &mut impl Fields, transition: &mut Transition) {
    let Transition { k, from, to, why, about } = transition;
    fields.u64(k);
    for value in [from, to, why, about] {
        fields.u32(value);
    }
}

fn status_fields(fields: &mut impl Fields, s: &mut Status) {
    header_fields(fields, &mut s.header);
    for value in [&mut s.k, &mut s.ticks, &mut s.missed_deadlines, &mut s.faults, &mut s.latched] {
        fields.u64(value);
    }
    for value in [&mut s.target_stamp.0, &mut s.state_stamp.0, &mut s.input_age_ns] {
        fields.u64(value);
    }
    for value in [&mut s.clearance_command_m, &mut s.clearance_measured_m, &mut s.tracking_error] {
        fields.f64(value);
    }
    for value in [&mut s.limb_error_target_rad, &mut s.limb_error_measured_rad, &mut s.speed_scale] {
        fields.f64(value);
    }
    for value in [&mut s.outside_by, &mut s.torso_to_go_m] {
        fields.f64(value);
    }
    for value in s.payload_kg.iter_mut().chain(s.payload_centre_m.as_flattened_mut()) {
        fields.f64(value);
    }
    for value in s.nearest_pair.iter_mut().chain(&mut s.nearest_pair_measured) {
        fields.u32(value);
    }
    for value in [&mut s.joint_outside, &mut s.reduced, &mut s.mode, &mut s.transition_count] {
        fields.u32(value);
    }
    for transition in &mut s.transitions {
        transition_fields(fields, transition);
    }
    for value in &mut s.fault_counts {
        fields.u32(value);
    }
    for value in [&mut s.gate_denials, &mut s.fallbacks, &mut s.operators, &mut s.realtime] {
        fields.u32(value);
    }
    for value in [&mut s.tracking_joint, &mut s.denied_why, &mut s.denied_about, &mut s.refused_about] {
        fields.u32(value);
    }
    for value in [
        &mut s.input_drop,
        &mut s.calibration,
        &mut s.reset_first_by,
        &mut s.resets_refused,
        &mut s.moving,
        &mut s.unsteady_joint,
        &mut s.payloads_taken,
        &mut s.payloads_refused,
        &mut s.payload_refused_why,
        &mut s.payload_refused_joint,
        &mut s.limited_why,
        &mut s.limited_about,
        &mut s.reserved,
    ] {
        fields.u32(value);
    }
}

/// Returns the bytes of a request.
pub fn encode_request(request: &OperatorRequest) -> [u8; REQUEST_BYTES] {
    let mut bytes = [0; REQUEST_BYTES];
    request_fields(&mut FieldWriter::new(&mut bytes), &mut { *request });
    bytes
}

/// Returns the request in `bytes`, or `None` if the length, the version or the level is unknown. `control` checks
/// the payload report, because a wrong one must not hide an emergency stop in the same request.
pub fn decode_request(bytes: &[u8]) -> Option<OperatorRequest> {
    let mut request = OperatorRequest::ZERO;
    if bytes.len() != REQUEST_BYTES {
        return None;
    }
    request_fields(&mut FieldReader::new(bytes), &mut request);
    (request.version == OPERATOR_VERSION && request.enable_level <= HOLDS_RECOVERY).then_some(request)
}

/// Returns the bytes of a status.
pub fn encode_status(status: &Status) -> [u8; STATUS_BYTES] {
    let mut bytes = [0; STATUS_BYTES];
    status_fields(&mut FieldWriter::new(&mut bytes), &mut { *status });
    bytes
}

/// Returns the status in `bytes`, or `None` if the length is not that of a `Status`.
pub fn decode_status(bytes: &[u8]) -> Option<Status> {
    let mut status = Status::ZERO;
    if bytes.len() != STATUS_BYTES {
        return None;
    }
    status_fields(&mut FieldReader::new(bytes), &mut status);
    Some(status)
}
