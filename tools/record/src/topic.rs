//! The channels of a recording.

use messages::{JointCommand, JointTarget, Message, RobotState, Skeleton, Status};
use serde_json::{Map, Value, json};

/// A channel. The first seven hold messages bit for bit, and `replay` reads them back. The others are for viewers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(usize)]
pub enum Topic {
    /// `Skeleton` as `ingest` passed it on.
    Skeleton,
    Target,
    Command,
    State,
    /// `Status`, every byte.
    StatusRaw,
    /// `JointTarget` of a policy, while one holds its lease.
    Policy,
    /// Inputs of a control tick that are not messages. Only in offline recordings.
    Inputs,
    Status,
    /// foxglove.JointStates: the robot's measurements.
    Measured,
    /// foxglove.JointStates: the targets.
    Wanted,
    /// foxglove.JointStates: the commands.
    Commanded,
    /// foxglove.JointStates: the targets of a policy.
    PolicyWanted,
    /// foxglove.FrameTransforms: every link of the robot.
    Transforms,
    /// foxglove.SceneUpdate: the person as lines.
    Person,
    /// foxglove.SceneUpdate: the robot's capsules.
    Capsules,
    /// foxglove.Log: events, one sentence each.
    Log,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Described {
    pub topic: &'static str,
    pub encoding: &'static str,
    pub name: String,
    pub schema_encoding: String,
    pub schema: Vec<u8>,
}

impl Topic {
    /// Every channel and its name, in their order.
    pub const ALL: [(Self, &'static str); 16] = [
        (Self::Skeleton, "/teleop/skeleton"),
        (Self::Target, "/teleop/joint_target"),
        (Self::Command, "/teleop/joint_command"),
        (Self::State, "/teleop/robot_state"),
        (Self::StatusRaw, "/teleop/status_raw"),
        (Self::Policy, "/teleop/policy_target"),
        (Self::Inputs, "/teleop/inputs"),
        (Self::Status, "/teleop/status"),
        (Self::Measured, "/joint_states/measured"),
        (Self::Wanted, "/joint_states/target"),
        (Self::Commanded, "/joint_states/command"),
        (Self::PolicyWanted, "/joint_states/policy"),
        (Self::Transforms, "/tf"),
        (Self::Person, "/scene/person"),
        (Self::Capsules, "/scene/robot"),
        (Self::Log, "/log"),
    ];

    pub const fn name(self) -> &'static str {
        Self::ALL[self as usize].1
    }

    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|(_, known)| *known == name).map(|(topic, _)| topic)
    }

    pub fn described(self) -> Described {
        match self {
            Self::Skeleton => ours::<Skeleton>(self),
            Self::Target | Self::Policy => ours::<JointTarget>(self),
            Self::Command => ours::<JointCommand>(self),
            Self::State => ours::<RobotState>(self),
            Self::StatusRaw => ours::<Status>(self),
            Self::Inputs => json_schema(self, "teleopd.Inputs", &crate::inputs::example()),
            Self::Status => json_schema(self, "teleopd.Status", &crate::inputs::status_example()),
            Self::Measured | Self::Wanted | Self::Commanded | Self::PolicyWanted => {
                viewed::<foxglove::messages::JointStates>(self)
            }
            Self::Transforms => viewed::<foxglove::messages::FrameTransforms>(self),
            Self::Person | Self::Capsules => viewed::<foxglove::messages::SceneUpdate>(self),
            Self::Log => viewed::<foxglove::messages::Log>(self),
        }
    }
}

/// Describes our own layout. The schema's name carries the hash, and its text lists the fields.
fn ours<M: Message>(topic: Topic) -> Described {
    let fields: Vec<_> = M::FIELDS
        .iter()
        .map(|field| json!({ "name": field.name, "type": field.ty, "offset": field.offset, "size": field.size }))
        .collect();
    let layout = json!({ "name": M::NAME, "version": M::VERSION, "size": size_of::<M>(), "byte_order": "little-endian",
        "fields": fields });
    Described {
        topic: topic.name(),
        encoding: "teleopd",
        name: M::TYPE_NAME.as_str().to_owned(),
        schema_encoding: "teleopd".to_owned(),
        schema: layout.to_string().into_bytes(),
    }
}

fn viewed<M: foxglove::Encode>(topic: Topic) -> Described {
    let schema = M::get_schema();
    let (name, encoding, data) =
        schema.map_or_else(Default::default, |schema| (schema.name, schema.encoding, schema.data.into_owned()));
    Described { topic: topic.name(), encoding: "protobuf", name, schema_encoding: encoding, schema: data }
}

fn json_schema(topic: Topic, title: &str, example: &Value) -> Described {
    let mut schema = schema_of(example);
    schema["title"] = json!(title);
    schema["$schema"] = json!("https://json-schema.org/draft/2020-12/schema");
    Described {
        topic: topic.name(),
        encoding: "json",
        name: title.to_owned(),
        schema_encoding: "jsonschema".to_owned(),
        schema: schema.to_string().into_bytes(),
    }
}

fn schema_of(value: &Value) -> Value {
    match value {
        // A value that is null in the example may have any type, because the number or text is optional.
        Value::Null => json!({}),
        Value::Bool(_) => json!({ "type": "boolean" }),
        Value::Number(number) if number.is_f64() => json!({ "type": "number" }),
        Value::Number(_) => json!({ "type": "integer" }),
        Value::String(_) => json!({ "type": "string" }),
        Value::Array(all) => json!({ "type": "array", "items": all.first().map_or(json!({}), schema_of) }),
        Value::Object(entries) => {
            let properties: Map<_, _> = entries.iter().map(|(key, value)| (key.clone(), schema_of(value))).collect();
            json!({ "type": "object", "properties": properties })
        }
    }
}
