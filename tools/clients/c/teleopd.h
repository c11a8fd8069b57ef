/* The layout of a frame, for clients in C and C++ that publish over iceoryx2 0.10 (payload type name below, size and
 * alignment of the struct). Written by cargo test -p messages --test all clients -- --ignored; not to be edited. */
#ifndef TELEOPD_H
#define TELEOPD_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
#define TELEOP_ASSERT(is, what) static_assert(is, what)
#else
#define TELEOP_ASSERT(is, what) _Static_assert(is, what)
#endif

/* the most joints that a frame can carry */
#define TELEOP_RAW_JOINTS_MAX 96
/* left upper arm, left forearm, right upper arm, right forearm */
#define TELEOP_LIMBS 4
/* SMPL-22, metres, x forward, y left, z up */
#define TELEOP_LAYOUT_SMPL22 1
/* SMPL-22 and both hands, in the same frame */
#define TELEOP_LAYOUT_SMPL24 2
/* OpenXR XR_BD_body_tracking, metres, x right, y up, z back */
#define TELEOP_LAYOUT_XR_BD24 3
/* MediaPipe Pose world landmarks, metres, y down, z away */
#define TELEOP_LAYOUT_MEDIAPIPE33 4
/* Azure Kinect, mm, x right, y down, z away; w x y z */
#define TELEOP_LAYOUT_AZURE_KINECT32 5
/* Xsens MVN segments, metres, z up; w x y z */
#define TELEOP_LAYOUT_XSENS_MVN23 6
/* Unity HumanBodyBones, left-handed, local rotations */
#define TELEOP_LAYOUT_UNITY 7
/* MediaPipe33, then the image landmarks, heights of the image from its middle, y down */
#define TELEOP_LAYOUT_MEDIAPIPE66 8
/* the image was mirrored: left and right are swapped */
#define TELEOP_FLAG_MIRRORED 1
/* rotations are filled */
#define TELEOP_FLAG_ROTATIONS 2
/* they are relative to the parent joint; of the positions the root's alone counts */
#define TELEOP_FLAG_LOCAL 4
/* the robot stands until a frame without it */
#define TELEOP_FLAG_CLUTCH 8
/* the two bytes of the hands' closures */
#define TELEOP_FLAG_CLOSURE 4294901760
/* the most bytes of a sentence */
#define TELEOP_SENTENCE_BYTES 256
/* mode, faults, speed_scale and sentence are known */
#define TELEOP_FEEDBACK_STATUS 1
/* clearances and limbs are known */
#define TELEOP_FEEDBACK_STATE 2
/* the person's left upper arm is seen */
#define TELEOP_FEEDBACK_LIMB_LEFT_UPPER 16
/* the person's left forearm is seen */
#define TELEOP_FEEDBACK_LIMB_LEFT_FORE 32
/* the person's right upper arm is seen */
#define TELEOP_FEEDBACK_LIMB_RIGHT_UPPER 64
/* the person's right forearm is seen */
#define TELEOP_FEEDBACK_LIMB_RIGHT_FORE 128
/* the left gripper is measured */
#define TELEOP_FEEDBACK_GRIPPER_LEFT 4
/* the right gripper is measured */
#define TELEOP_FEEDBACK_GRIPPER_RIGHT 8
/* all four hinges of the calibration are valid */
#define TELEOP_CALIBRATION_ALL 15
/* the most joints of a robot */
#define TELEOP_JOINTS_MAX 24
/* the most rows of a policy's chunk */
#define TELEOP_CHUNK_ROWS_MAX 100
/* the chunk has velocities */
#define TELEOP_CHUNK_VELOCITIES 1
/* the chunk has the left gripper */
#define TELEOP_CHUNK_CLOSURE_LEFT 2
/* the chunk has the right gripper */
#define TELEOP_CHUNK_CLOSURE_RIGHT 4
/* the robot's state is known */
#define TELEOP_JOINTS_STATE 1
/* mode and sources are known */
#define TELEOP_JOINTS_STATUS 2
/* a policy holds its lease */
#define TELEOP_JOINTS_POLICY 4
/* a person leads the left arm */
#define TELEOP_SOURCE_PERSON_LEFT 1
/* a person leads the right arm */
#define TELEOP_SOURCE_PERSON_RIGHT 2
/* a policy leads the left arm */
#define TELEOP_SOURCE_POLICY_LEFT 4
/* a policy leads the right arm */
#define TELEOP_SOURCE_POLICY_RIGHT 8
#define TELEOP_MODE_DISENGAGED 0
#define TELEOP_MODE_ENGAGING 1
#define TELEOP_MODE_ENGAGED 2
#define TELEOP_MODE_HOLDING 3
#define TELEOP_MODE_FAULTED 4
#define TELEOP_MODE_RECOVERING 5
/* the service that policies write, and the one that has the joints */
#define TELEOP_POLICY_SERVICE "teleop/policy_chunk/1"
#define TELEOP_JOINTS_SERVICE "teleop/joints/2"
/* the service that tells clients about the robot */
#define TELEOP_FEEDBACK_SERVICE "teleop/feedback/1"
/* the service that clients write, and the one that wakes its reader */
#define TELEOP_SERVICE "teleop/raw_skeleton/1"
#define TELEOP_EVENT_SERVICE "teleop/raw_skeleton/1/event"

/* What every message begins with. Times are CLOCK_MONOTONIC, ns. */
typedef struct teleop_header {
    uint64_t sequence;
    uint64_t stamp;
    uint64_t origin;
    uint64_t config_hash;
    uint32_t incarnation;
    uint32_t reserved;
} teleop_header;
#define TELEOP_HEADER_TYPE_NAME "teleop.Header.v1.4983969c05860a03"
TELEOP_ASSERT(sizeof(teleop_header) == 40, "teleop_header");
TELEOP_ASSERT(offsetof(teleop_header, sequence) == 0, "sequence");
TELEOP_ASSERT(offsetof(teleop_header, stamp) == 8, "stamp");
TELEOP_ASSERT(offsetof(teleop_header, origin) == 16, "origin");
TELEOP_ASSERT(offsetof(teleop_header, config_hash) == 24, "config_hash");
TELEOP_ASSERT(offsetof(teleop_header, incarnation) == 32, "incarnation");
TELEOP_ASSERT(offsetof(teleop_header, reserved) == 36, "reserved");

/* Elbow hinge axes, unit vectors in the frames of the joints that carry them. */
typedef struct teleop_hinge_calibration {
    float hinge[TELEOP_LIMBS][3];
    uint32_t flags;
    uint32_t samples;
} teleop_hinge_calibration;
#define TELEOP_HINGE_CALIBRATION_TYPE_NAME "teleop.HingeCalibration.v1.1ad67fb992569fe3"
TELEOP_ASSERT(sizeof(teleop_hinge_calibration) == 56, "teleop_hinge_calibration");
TELEOP_ASSERT(offsetof(teleop_hinge_calibration, hinge) == 0, "hinge");
TELEOP_ASSERT(offsetof(teleop_hinge_calibration, flags) == 48, "flags");
TELEOP_ASSERT(offsetof(teleop_hinge_calibration, samples) == 52, "samples");

/* A frame of a person. */
typedef struct teleop_raw_skeleton {
    teleop_header header;
    uint64_t session_nonce;
    uint32_t layout;
    uint32_t operator_id;
    uint32_t flags;
    uint32_t joint_count;
    float positions[TELEOP_RAW_JOINTS_MAX][3];
    float rotations[TELEOP_RAW_JOINTS_MAX][4];
    float confidence[TELEOP_RAW_JOINTS_MAX];
    uint32_t joint_flags[TELEOP_RAW_JOINTS_MAX];
    teleop_hinge_calibration calibration;
} teleop_raw_skeleton;
#define TELEOP_RAW_SKELETON_TYPE_NAME "teleop.RawSkeleton.v1.dfc4ba58ef1b0e5e"
TELEOP_ASSERT(sizeof(teleop_raw_skeleton) == 3576, "teleop_raw_skeleton");
TELEOP_ASSERT(offsetof(teleop_raw_skeleton, header) == 0, "header");
TELEOP_ASSERT(offsetof(teleop_raw_skeleton, session_nonce) == 40, "session_nonce");
TELEOP_ASSERT(offsetof(teleop_raw_skeleton, layout) == 48, "layout");
TELEOP_ASSERT(offsetof(teleop_raw_skeleton, operator_id) == 52, "operator_id");
TELEOP_ASSERT(offsetof(teleop_raw_skeleton, flags) == 56, "flags");
TELEOP_ASSERT(offsetof(teleop_raw_skeleton, joint_count) == 60, "joint_count");
TELEOP_ASSERT(offsetof(teleop_raw_skeleton, positions) == 64, "positions");
TELEOP_ASSERT(offsetof(teleop_raw_skeleton, rotations) == 1216, "rotations");
TELEOP_ASSERT(offsetof(teleop_raw_skeleton, confidence) == 2752, "confidence");
TELEOP_ASSERT(offsetof(teleop_raw_skeleton, joint_flags) == 3136, "joint_flags");
TELEOP_ASSERT(offsetof(teleop_raw_skeleton, calibration) == 3520, "calibration");

/* State of the robot for the person who drives it. Directions: torso, x forward, y left, z up. */
typedef struct teleop_feedback {
    teleop_header header;
    uint64_t faults;
    uint32_t mode;
    uint32_t known;
    float speed_scale;
    float clearance_m[2];
    float towards_nearest[2][3];
    float limb_behind_rad[TELEOP_LIMBS];
    float closure[2];
    float force_n[2];
    uint32_t sentence_bytes;
    uint8_t sentence[TELEOP_SENTENCE_BYTES];
} teleop_feedback;
#define TELEOP_FEEDBACK_TYPE_NAME "teleop.Feedback.v1.6ab268c77bf85042"
TELEOP_ASSERT(sizeof(teleop_feedback) == 384, "teleop_feedback");
TELEOP_ASSERT(offsetof(teleop_feedback, header) == 0, "header");
TELEOP_ASSERT(offsetof(teleop_feedback, faults) == 40, "faults");
TELEOP_ASSERT(offsetof(teleop_feedback, mode) == 48, "mode");
TELEOP_ASSERT(offsetof(teleop_feedback, known) == 52, "known");
TELEOP_ASSERT(offsetof(teleop_feedback, speed_scale) == 56, "speed_scale");
TELEOP_ASSERT(offsetof(teleop_feedback, clearance_m) == 60, "clearance_m");
TELEOP_ASSERT(offsetof(teleop_feedback, towards_nearest) == 68, "towards_nearest");
TELEOP_ASSERT(offsetof(teleop_feedback, limb_behind_rad) == 92, "limb_behind_rad");
TELEOP_ASSERT(offsetof(teleop_feedback, closure) == 108, "closure");
TELEOP_ASSERT(offsetof(teleop_feedback, force_n) == 116, "force_n");
TELEOP_ASSERT(offsetof(teleop_feedback, sentence_bytes) == 124, "sentence_bytes");
TELEOP_ASSERT(offsetof(teleop_feedback, sentence) == 128, "sentence");

/* The robot that a message is about. */
typedef struct teleop_robot_id {
    uint64_t hash;
    uint32_t joint_count;
    uint32_t reserved;
} teleop_robot_id;
#define TELEOP_ROBOT_ID_TYPE_NAME "teleop.RobotId.v1.41c6f16b2eb09755"
TELEOP_ASSERT(sizeof(teleop_robot_id) == 16, "teleop_robot_id");
TELEOP_ASSERT(offsetof(teleop_robot_id, hash) == 0, "hash");
TELEOP_ASSERT(offsetof(teleop_robot_id, joint_count) == 8, "joint_count");
TELEOP_ASSERT(offsetof(teleop_robot_id, reserved) == 12, "reserved");

/* Joint targets of a policy: row i is due at start + i * period_ns. Positions in rad or m. */
typedef struct teleop_policy_chunk {
    teleop_header header;
    uint64_t session_nonce;
    teleop_robot_id robot;
    uint64_t received;
    uint64_t start;
    uint64_t period_ns;
    uint32_t rows;
    uint32_t valid_mask;
    uint32_t flags;
    uint32_t reserved;
    float q[TELEOP_CHUNK_ROWS_MAX][TELEOP_JOINTS_MAX];
    float v[TELEOP_CHUNK_ROWS_MAX][TELEOP_JOINTS_MAX];
    float closure[TELEOP_CHUNK_ROWS_MAX][2];
} teleop_policy_chunk;
#define TELEOP_POLICY_CHUNK_TYPE_NAME "teleop.PolicyChunk.v1.81b56ee2e4a9d87e"
TELEOP_ASSERT(sizeof(teleop_policy_chunk) == 20104, "teleop_policy_chunk");
TELEOP_ASSERT(offsetof(teleop_policy_chunk, header) == 0, "header");
TELEOP_ASSERT(offsetof(teleop_policy_chunk, session_nonce) == 40, "session_nonce");
TELEOP_ASSERT(offsetof(teleop_policy_chunk, robot) == 48, "robot");
TELEOP_ASSERT(offsetof(teleop_policy_chunk, received) == 64, "received");
TELEOP_ASSERT(offsetof(teleop_policy_chunk, start) == 72, "start");
TELEOP_ASSERT(offsetof(teleop_policy_chunk, period_ns) == 80, "period_ns");
TELEOP_ASSERT(offsetof(teleop_policy_chunk, rows) == 88, "rows");
TELEOP_ASSERT(offsetof(teleop_policy_chunk, valid_mask) == 92, "valid_mask");
TELEOP_ASSERT(offsetof(teleop_policy_chunk, flags) == 96, "flags");
TELEOP_ASSERT(offsetof(teleop_policy_chunk, reserved) == 100, "reserved");
TELEOP_ASSERT(offsetof(teleop_policy_chunk, q) == 104, "q");
TELEOP_ASSERT(offsetof(teleop_policy_chunk, v) == 9704, "v");
TELEOP_ASSERT(offsetof(teleop_policy_chunk, closure) == 19304, "closure");

/* The joints of the robot, 100 times a second, in rad, m and s. */
typedef struct teleop_joints {
    teleop_header header;
    teleop_robot_id robot;
    uint64_t k;
    uint32_t mode;
    uint32_t sources;
    uint32_t known;
    uint32_t chunk_dropped_why;
    uint64_t chunks_dropped[8];
    double commanded[TELEOP_JOINTS_MAX];
    double commanded_v[TELEOP_JOINTS_MAX];
    double measured[TELEOP_JOINTS_MAX];
    double measured_v[TELEOP_JOINTS_MAX];
    double short_of[TELEOP_JOINTS_MAX];
} teleop_joints;
#define TELEOP_JOINTS_TYPE_NAME "teleop.Joints.v2.e74329851af83f2e"
TELEOP_ASSERT(sizeof(teleop_joints) == 1104, "teleop_joints");
TELEOP_ASSERT(offsetof(teleop_joints, header) == 0, "header");
TELEOP_ASSERT(offsetof(teleop_joints, robot) == 40, "robot");
TELEOP_ASSERT(offsetof(teleop_joints, k) == 56, "k");
TELEOP_ASSERT(offsetof(teleop_joints, mode) == 64, "mode");
TELEOP_ASSERT(offsetof(teleop_joints, sources) == 68, "sources");
TELEOP_ASSERT(offsetof(teleop_joints, known) == 72, "known");
TELEOP_ASSERT(offsetof(teleop_joints, chunk_dropped_why) == 76, "chunk_dropped_why");
TELEOP_ASSERT(offsetof(teleop_joints, chunks_dropped) == 80, "chunks_dropped");
TELEOP_ASSERT(offsetof(teleop_joints, commanded) == 144, "commanded");
TELEOP_ASSERT(offsetof(teleop_joints, commanded_v) == 336, "commanded_v");
TELEOP_ASSERT(offsetof(teleop_joints, measured) == 528, "measured");
TELEOP_ASSERT(offsetof(teleop_joints, measured_v) == 720, "measured_v");
TELEOP_ASSERT(offsetof(teleop_joints, short_of) == 912, "short_of");

/* A frame's flags with the closure of the left and of the right hand, 0 (open) to 1 (closed). NAN for a hand that is not
 * known. */
static inline uint32_t teleop_with_closure(uint32_t flags, float left, float right)
{
    const float hands[2] = { left, right };
    int side;
    flags &= ~(uint32_t)TELEOP_FLAG_CLOSURE;
    for (side = 0; side < 2; side++) {
        const float low = hands[side] < 0.0f ? 0.0f : hands[side];
        const float closure = low > 1.0f ? 1.0f : low;
        if (closure == closure) flags |= (uint32_t)(1.5f + 254.0f * closure) << (16 + 8 * side);
    }
    return flags;
}

#endif
