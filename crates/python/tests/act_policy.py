"""ACT of lerobot learns a motion from recordings, leads the simulated robot by chunks, and is recorded and loaded again.

Twenty demonstrations are the motion at twenty speeds, in virtual time. ACT sees measured positions and velocities of both arms. Its chunk of
30 rows begins where the observation was made, so the time that it thinks is lateness, as a robot has it. Overlapping chunks are blended.

    python3 act_policy.py FOLDER REPLAY [SECONDS OF TRAINING]

FOLDER/chunks.json keeps what ACT sent: when, from when on, and the rows, to a thousandth. `tools/record/tests/act_chunks.json` is the beginning of such a
file, which a test of `record` plays, records and replays bit for bit.
"""

import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import torch
from lerobot.configs.types import FeatureType, PolicyFeature
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from lerobot.policies.act.configuration_act import ACTConfig
from lerobot.policies.act.modeling_act import ACTPolicy

import teleopd
from rig import INTERRUPTED, Rig, end
from teleopd import client, lerobot

folder, replay = Path(sys.argv[1]), Path(sys.argv[2])
train_s = float(sys.argv[3]) if len(sys.argv) > 3 else 120.0
FPS, ROWS, DEMONSTRATIONS, LEAD_S = 30, 30, 20, 30.0
#: Rows between two chunks, and rows over which a chunk takes over from the one before.
EVERY, BLENDED = 5, 8
torch.set_num_threads(1)
torch.manual_seed(1)

# Twenty recordings of one motion.
motion = Path("tools/replay/motions/wave-left.bvh")
recordings = []
for i, speed in enumerate(np.linspace(0.8, 1.2, DEMONSTRATIONS)):
    recordings.append(folder / f"demonstration-{i}.mcap")
    words = [replay, motion, "--speed", f"{speed:.3f}", "--offline", folder / "out.csv", "--record", recordings[-1]]
    subprocess.run(list(map(str, words)), check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
exported = lerobot.export(recordings, folder / "demonstrations", fps=FPS)
assert exported.episodes == DEMONSTRATIONS and not exported.failed, exported

# What ACT sees and says.
robot = teleopd.Robot("tiago_dual")
arms = [j for j, name in enumerate(robot.joint_names) if name.startswith("arm_")]
stamps = {"observation.state": [-1 / FPS, 0.0], "action": [i / FPS for i in range(ROWS)]}
dataset = LeRobotDataset("local/demonstrations", root=folder / "demonstrations", delta_timestamps=stamps)
items = [dataset[i] for i in range(len(dataset))]
items = [item for item in items if teleopd.MODES[int(item["mode"])] == "Engaged" and not item["observation.state_is_pad"].any()]
before, state = torch.stack([item["observation.state"][:, arms] for item in items]).unbind(1)
actions = torch.stack([item["action"][:, arms] for item in items])
padded = torch.stack([item["action_is_pad"] for item in items])
seen = torch.cat([state, (state - before) * FPS], 1)
scale = {"seen": (seen.mean(0), seen.std(0) + 1e-3), "action": (actions[:, 0].mean(0), actions[:, 0].std(0) + 1e-3)}
seen, actions = (seen - scale["seen"][0]) / scale["seen"][1], (actions - scale["action"][0]) / scale["action"][1]

wide = len(arms)
config = ACTConfig(
    input_features={"observation.state": PolicyFeature(FeatureType.STATE, (wide,)),
                    "observation.environment_state": PolicyFeature(FeatureType.ENV, (wide,))},
    output_features={"action": PolicyFeature(FeatureType.ACTION, (wide,))}, chunk_size=ROWS, n_action_steps=ROWS, dim_model=64, n_heads=4,
    dim_feedforward=128, n_encoder_layers=2, use_vae=False, dropout=0.0, device="cpu", push_to_hub=False,
)
policy = ACTPolicy(config)


def inputs(values):
    """Positions are the state. ACT wants an image or a state of the environment: here the velocities."""
    return {"observation.state": values[:, :wide], "observation.environment_state": values[:, wide:]}


optimizer = torch.optim.AdamW(policy.parameters(), lr=1e-3, weight_decay=1e-4)
steps, begun, loss = 0, time.process_time(), None
while time.process_time() - begun < train_s:
    optimizer.param_groups[0]["lr"] = 1e-3 * (1.0 - (time.process_time() - begun) / train_s) + 1e-6
    at = torch.randint(len(items), (64,))
    # An observation is never where a demonstration was.
    noisy = seen[at] + 0.05 * torch.randn(64, 2 * wide)
    loss, _ = policy({**inputs(noisy), "action": actions[at], "action_is_pad": padded[at]})
    optimizer.zero_grad()
    loss.backward()
    optimizer.step()
    steps += 1
print(f"ACT: {sum(p.numel() for p in policy.parameters())} weights, {steps} steps in {train_s:.0f} s of one core, loss {loss.item():.3f} "
      f"standard deviations, {len(items)} frames of {DEMONSTRATIONS} demonstrations")


def chunk(joints):
    now = torch.tensor([[*(joints.measured[j] for j in arms), *(joints.measured_v[j] for j in arms)]])
    rows = policy.predict_action_chunk(inputs((now - scale["seen"][0]) / scale["seen"][1]))[0]
    return (rows * scale["action"][1] + scale["action"][0]).numpy()


# It leads the simulated robot.
recording = folder / "policy.mcap"
engage, thought_ms, modes, reasons, sent = None, [], [], set(), []
with Rig(folder, replay.parent, "--record", recording) as rig, client.Policy(rig.run_dir, [robot.joint_names[j] for j in arms]) as leader:
    begun, last = time.monotonic(), None
    while time.monotonic() - begun < LEAD_S:
        joints = leader.observe()
        started = time.monotonic()
        rows = chunk(joints)
        thought_ms.append(1e3 * (time.monotonic() - started))
        if last is not None:
            # The chunk before began some rows ago. Its share falls over the first rows.
            gone = round((joints.header.stamp - last[0]) * 1e-9 * FPS)
            for i in range(min(BLENDED, ROWS - gone)):
                rows[i] += (1.0 - i / BLENDED) * (last[1][gone + i] - rows[i])
        last = (joints.header.stamp, rows)
        leader.publish(rows.tolist(), rate_hz=FPS, start_ns=joints.header.stamp)
        sent.append({"sent_ms": time.monotonic_ns() / 1e6, "start_ms": joints.header.stamp / 1e6, "positions": rows.round(3).tolist()})
        engage = engage or rig.start("teleopctl", "engage")
        modes.append(client.MODES[joints.mode])
        if leader.dropped():
            reasons.add(leader.dropped())
        time.sleep(EVERY / FPS)
    codes = end(engage, rig.up)
first_ms = sent[0]["start_ms"]
for one in sent:
    one.update({key: round(one[key] - first_ms, 3) for key in ("sent_ms", "start_ms")})
(folder / "chunks.json").write_text(json.dumps({"joints": arms, "rate_hz": FPS, "chunks": sent}))
assert codes == [0, INTERRUPTED], codes
share = modes.count("Engaged") / len(modes)
print(f"led for {LEAD_S:.0f} s: Engaged in {100 * share:.0f} % of {len(modes)} chunks, one takes {np.median(thought_ms):.1f} ms (p99 "
      f"{np.quantile(thought_ms, 0.99):.1f}), dropped: {', '.join(sorted(reasons)) or 'none'}")
assert share > 0.5, "the robot did not follow the policy"

# The recording says who led, and is a dataset again.
commands = teleopd.read_recording(recording).messages["commands"]
led = commands["sources"] == 12
assert set(np.unique(commands["sources"])) <= {0, 12} and led.mean() > 0.5, np.unique(commands["sources"], return_counts=True)
exported = lerobot.export([recording], folder / "policy", fps=FPS)
again = LeRobotDataset("local/policy", root=folder / "policy")
assert len(again) == exported.frames > 0.5 * len(led) / 1500 * FPS
by_policy = np.array([int(again[i]["source"][2]) for i in range(len(again))]) == 12
action = np.stack([again[i]["action"].numpy() for i in range(len(again))])[by_policy][:, arms]
demonstrated = np.stack([item["action"][0].numpy() for item in items])[:, arms]
wished = np.stack([again[i]["policy"].numpy() for i in range(len(again))])[by_policy][:, arms]
assert np.degrees(np.median(np.abs(wished - action).max(1))) < 10.0, "the recording has not what the policy asked for"
nearest = np.array([np.abs(demonstrated - row).max(1).min() for row in action])
moved = np.ptp(action, axis=0).max()
print(f"{exported.frames} frames again, {by_policy.sum()} led by the policy; it moved a joint by {np.degrees(moved):.0f} degrees, and stayed within "
      f"{np.degrees(np.median(nearest)):.1f} degrees of a demonstration (median of the worst joint)")
assert moved > np.radians(20.0), "the policy hardly moved the robot"
