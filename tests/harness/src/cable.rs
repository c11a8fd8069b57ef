//! A cable between this machine and a network namespace. It needs root, ip(8) and nft(8).

use std::process::Command;

/// A cable. A drop takes it away.
pub struct Cable {
    /// Name of the network namespace.
    namespace: &'static str,
    /// The interfaces here and there.
    pub ends: [&'static str; 2],
    /// Address here.
    pub host: String,
}

impl Cable {
    /// Lays it, with addresses in 10.231.`subnet`.0/24. The error says why it cannot.
    pub fn lay(namespace: &'static str, ends: [&'static str; 2], subnet: u8) -> Result<Self, String> {
        let cable = Self { namespace, ends, host: format!("10.231.{subnet}.1") };
        let [here, there] = ends;
        shell("nft --version")?;
        // Left behind by a test that was killed.
        cable.take_away();
        shell(&format!("ip netns add {namespace}"))?;
        shell(&format!("ip link add {here} type veth peer name {there} netns {namespace}"))?;
        shell(&format!("ip address add {}/24 dev {here} && ip link set {here} up", cable.host))?;
        cable.there(&format!("ip address add 10.231.{subnet}.2/24 dev {there}"))?;
        cable.there(&format!("ip link set {there} up"))?;
        cable.there("ip link set lo up")?;
        Ok(cable)
    }

    /// Prefix of a command that runs there.
    pub fn prefix(&self) -> [&'static str; 4] {
        ["ip", "netns", "exec", self.namespace]
    }

    /// Runs a command there.
    pub fn there(&self, command: &str) -> Result<(), String> {
        shell(&format!("{} {command}", self.prefix().join(" ")))
    }

    /// Drops this share of the packets in each way, %. Fragments of a datagram are packets of their own.
    pub fn lose(&self, percent: u32) -> Result<(), String> {
        let which = if percent < 100 { format!("numgen random mod 100 < {percent}") } else { String::new() };
        for (n, end) in self.ends.into_iter().enumerate() {
            let drop = format!("chain in {{ type filter hook ingress device {end} priority 0; {which} drop\n}}");
            let table = format!("table netdev {end} {{}}\ndelete table netdev {end}\ntable netdev {end} {{ {drop}\n}}");
            let rules = format!("nft '{table}'");
            if n == 0 { shell(&rules)? } else { self.there(&rules)? }
        }
        Ok(())
    }

    /// Takes the cable away. What was never laid cannot be taken away.
    fn take_away(&self) {
        let _ = shell(&format!("nft delete table netdev {}", self.ends[0]));
        let _ = shell(&format!("ip link del {}", self.ends[0]));
        let _ = shell(&format!("ip netns del {}", self.namespace));
    }
}

impl Drop for Cable {
    fn drop(&mut self) {
        self.take_away();
    }
}

/// Runs a command of the shell.
pub fn shell(command: &str) -> Result<(), String> {
    let done = Command::new("sh").args(["-c", command]).output().map_err(|error| error.to_string())?;
    let printed = String::from_utf8_lossy(&done.stderr);
    if done.status.success() { Ok(()) } else { Err(format!("{command}: {}", printed.trim())) }
}
