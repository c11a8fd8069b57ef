//! The channels of a recording.

use messages::{JointCommand, JointTarget, Message, RobotState, Skeleton, Status};
use serde_json::{Map, Value, json};

messages::named! {
    /// A channel. The first seven hold messages bit for bit, and `replay` reads them back. The others are for viewers.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
    #[repr(usize)]
    pub enum Topic {
        /// `Skeleton` as `ingest` passed it on.
        Skeleton => "/teleop/skeleton",
        Target => "/teleop/joint_target",
        Command => "/teleop/joint_command",
        State => "/teleop/robot_state",
        /// `Status`, every byte.
        StatusRaw => "/teleop/status_raw",
        /// `JointTarget` of a policy, while one holds its lease.
        Policy => "/teleop/policy_target",
        /// Inputs of a control tick that are not messages. Only in offline recordings.
        Inputs => "/teleop/inputs",
        Status => "/teleop/status",
        /// foxglove.JointStates: the robot's measurements.
        Measured => "/joint_states/measured",
        /// foxglove.JointStates: the targets.
        Wanted => "/joint_states/target",
        /// foxglove.JointStates: the commands.
        Commanded => "/joint_states/command",
        /// foxglove.JointStates: the targets of a policy.
        PolicyWanted => "/joint_states/policy",
        /// foxglove.FrameTransforms: every link of the robot.
        Transforms => "/tf",
        /// foxglove.SceneUpdate: the person as lines.
        Person => "/scene/person",
        /// foxglove.SceneUpdate: the robot's capsules.
        Capsules => "/scene/robot",
        /// foxglove.Log: events, one sentence each.
        Log => "/log",
    }
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
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|topic| topic.name() == name)
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
