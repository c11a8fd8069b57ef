//! The weights file: a safetensors file and a TOML manifest that ties it to one robot. It turns bytes into networks.

use perceptron::{WIDTH_MAX, WeightsError, WriteError, key, must, must_match, sha256_hex};
use serde::{Deserialize, Serialize};

use crate::arm::{ARM_Q, ArmModel, ArmQ, FEATURES};
use crate::network::{HIDDEN_MAX, LATENT, Layers, Network, golden};

/// The only format of the manifest so far.
pub const FORMAT: u32 = 1;
/// End of the name of a weights file for a right arm that does not mirror the left one.
pub const RIGHT_ARM: &str = "_right";
/// Largest difference between the limits that a network was trained for and the robot's, rad: rounding of decimal text.
const LIMIT_TOLERANCE_RAD: f64 = 1e-9;

/// Identity of an arm that a weights file must match.
#[derive(Clone, Debug, PartialEq)]
pub struct ArmIdentity {
    /// Name of the robot.
    pub robot: String,
    /// Hash of the arm's data in the robot's files.
    pub robot_hash: u64,
    /// Names of joints 1 to 5 of the left arm.
    pub joints: [String; ARM_Q],
    /// The arm.
    pub arm: ArmModel,
}

/// The manifest beside a safetensors file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// `FORMAT`.
    pub format: u32,
    /// SHA-256 of the safetensors file, lower-case hex.
    pub sha256: String,
    /// Name of the robot.
    pub robot: String,
    /// Hash as in [`ArmIdentity`], 16 lower-case hex digits. TOML has no unsigned 64-bit integers.
    pub robot_hash: String,
    /// Names of joints 1 to 5 of the left arm.
    pub joints: [String; ARM_Q],
    /// Middle of the joint limits, rad.
    pub mid_rad: ArmQ,
    /// Half of the range of the joint limits, rad.
    pub half_rad: ArmQ,
    /// `LATENT`.
    pub latent: usize,
    /// Hidden layers of each network.
    pub hidden_layers: usize,
    /// Neurons of each hidden layer.
    pub hidden_width: usize,
    /// Seed of the training.
    pub seed: u64,
    /// Steps of the training.
    pub steps: u64,
    /// Description of the training data.
    pub trained_on: String,
    /// Figures of the validation, for the reader.
    #[serde(default)]
    pub validation: toml::Table,
}

impl Manifest {
    /// Creates a manifest for `identity` and the shape of `layers`. Its sha256, validation and training facts are
    /// still empty.
    pub fn new(identity: &ArmIdentity, layers: &Layers) -> Self {
        Self {
            format: FORMAT,
            sha256: String::new(),
            robot: identity.robot.clone(),
            robot_hash: format!("{:016x}", identity.robot_hash),
            joints: identity.joints.clone(),
            mid_rad: identity.arm.mid(),
            half_rad: identity.arm.half(),
            latent: LATENT,
            hidden_layers: layers.human.len().saturating_sub(1),
            hidden_width: layers.human.first().map_or(0, |layer| layer.outputs),
            seed: 0,
            steps: 0,
            trained_on: String::new(),
            validation: toml::Table::new(),
        }
    }

    fn check(&self, identity: &ArmIdentity) -> Result<(), WeightsError> {
        let robot_hash = format!("{:016x}", identity.robot_hash);
        must("format", self.format, FORMAT)?;
        must("robot", &self.robot, &identity.robot)?;
        must("robot_hash", &self.robot_hash, &robot_hash)?;
        must("latent", self.latent, LATENT)?;
        if self.joints != identity.joints {
            return Err(key("joints", &self.joints, format!("{:?}", identity.joints)));
        }
        for (name, value, expected) in
            [("mid_rad", self.mid_rad, identity.arm.mid()), ("half_rad", self.half_rad, identity.arm.half())]
        {
            // Written so that a NaN is refused too.
            if !(0..ARM_Q).all(|j| (value[j] - expected[j]).abs() <= LIMIT_TOLERANCE_RAD) {
                return Err(key(name, &value, format!("{expected:?} (the robot's joint limits)")));
            }
        }
        if !(1..=HIDDEN_MAX).contains(&self.hidden_layers) {
            return Err(key("hidden_layers", &self.hidden_layers, format!("1 to {HIDDEN_MAX}")));
        }
        if !(1..=WIDTH_MAX).contains(&self.hidden_width) {
            return Err(key("hidden_width", &self.hidden_width, format!("1 to {WIDTH_MAX}")));
        }
        Ok(())
    }
}

/// Checked weights of one robot, ready to run.
#[derive(Clone, Debug)]
pub struct Weights {
    /// The networks.
    pub network: Network,
    /// The manifest that came with them.
    pub manifest: Manifest,
}

impl Weights {
    /// Reads the manifest and the safetensors file that it describes, for the robot `identity`. It refuses
    /// everything that differs from the manifest or from what the robot needs.
    pub fn read(manifest_text: &str, bytes: &[u8], identity: &ArmIdentity) -> Result<Self, WeightsError> {
        let manifest: Manifest = toml::from_str(manifest_text)?;
        manifest.check(identity)?;
        must_match(bytes, &manifest.sha256)?;
        let layers = read_layers(bytes, &manifest)?;
        let network = Network::new(&layers, &identity.arm);
        golden::error(&network, &layers).map_err(|error| WeightsError::Golden { error })?;
        Ok(Self { network, manifest })
    }
}

/// Reads the layers of a safetensors file, checked against the shape in `manifest`.
pub fn read_layers(bytes: &[u8], manifest: &Manifest) -> Result<Layers, WeightsError> {
    let widths = |inputs: usize, outputs: usize| {
        let hidden = vec![manifest.hidden_width; manifest.hidden_layers];
        [&[inputs], &hidden[..], &[outputs]].concat()
    };
    let [human, robot, decoder] = [widths(FEATURES, LATENT), widths(ARM_Q, LATENT), widths(LATENT, ARM_Q)];
    let networks = [("human", &human[..]), ("robot", &robot[..]), ("decoder", &decoder[..])];
    let [human, robot, decoder] = perceptron::read_networks(bytes, networks)?;
    Ok(Layers { human, robot, decoder })
}

/// Writes the two files of a weights folder: safetensors bytes and manifest text with its `sha256` filled in.
pub fn write_weights(layers: &Layers, manifest: &Manifest) -> Result<(Vec<u8>, String), WriteError> {
    let bytes =
        perceptron::write_layers(&[("human", &layers.human), ("robot", &layers.robot), ("decoder", &layers.decoder)])?;
    let manifest = Manifest { sha256: sha256_hex(&bytes), ..manifest.clone() };
    Ok((bytes, toml::to_string(&manifest)?))
}
