"""A TIAGo++ on ROS 2 Humble, played without ROS: controllers, body and judge. See README.md beside this file."""

import argparse
import csv
import gc
import json
import os
import select
import signal
import sys
import time
from collections import deque
from pathlib import Path

import numpy as np

import arm_sdk
import body
import encoders
import faults
import forward
import hands
import robot
import unitree
from judge import Judge
from trajectory import NS_PER_S, Controller
from wire import Wire

ROBOT = Path(__file__).parents[2] / "config/robots/tiago_dual.toml"
#: joint_state_broadcaster and state of the controllers, Hz: `update_rate` in the published configuration of TIAGo Pro.
STATE_HZ = 50
#: The peer reports a G1's motors at this rate, Hz, so that half a core is enough. A G1 has 500 (assumption).
LOW_STATE_HZ = 250
#: The emergency stop is published on change and at this rate, Hz. It is an assumption.
EMERGENCY_HZ = 1
#: `goal` (rad) and `goal_time` (s) of the published configurations: arms and, by assumption, torso; head.
GOAL, GOAL_HEAD = (0.02, 0.6), (0.5, 2.0)
#: A peer that is later than this is no robot any more. It is an assumption.
LATE_MAX_S = 1.0


class Hand:
    """A gripper with its controller and its judge."""

    def __init__(self, gripper: hands.Gripper, args: argparse.Namespace, period_s: float):
        self.joints = gripper.joints
        self.controller = Controller(gripper.joints, *hands.GOAL)
        self.fingers = hands.Fingers(gripper, args.object_width_m)
        self.judge = hands.Judge(gripper, period_s)
        self.command, self.reference = self.fingers.position.copy(), None

    def update(self, clock_ns: int, inactive: bool, emergency: bool) -> None:
        if inactive:
            self.controller.curve = self.controller.incoming = None
            return
        self.reference = self.controller.update(clock_ns, self.fingers.position)
        if not emergency:
            self.command = self.reference.positions

    def press(self, pressed: bool, before: bool | None, clock_ns: int) -> None:
        """As with the other joints: brakes hold the fingers, and on release the controller holds that posture."""
        if pressed and not before:
            self.command = self.fingers.position.copy()
        if before and not pressed:
            self.controller.hold(clock_ns, self.fingers.position)


class Peer:
    def __init__(self, args: argparse.Namespace):
        self.args = args
        self.robot = robot.load(args.robot, args.urdf)
        self.period_s = 1 / args.update_hz
        self.body = body.Ideal(self.robot, args.lag_ms / 1e3) if args.no_physics else body.Body(self.robot, args)
        self.judge = Judge(self.robot, self.period_s)
        self.faults = faults.Faults(args.fault, args.seed)
        self.state_hz = LOW_STATE_HZ if args.commands == "arm_sdk" else STATE_HZ
        make = {"trajectories": lambda name, joints: Controller(joints, *(GOAL_HEAD if "head" in name else GOAL)),
                "positions": lambda _, joints: forward.Controller(joints), "arm_sdk": lambda _, joints: arm_sdk.Controller(joints)}
        self.controllers = {name: make[args.commands](name, joints) for name, joints in self.robot.controllers.items()}
        # A robot without fingers says nothing of them, and has no controller for them.
        grippers = {} if args.without_fingers or args.commands != "trajectories" else self.robot.grippers
        self.hands = {name: Hand(gripper, args, self.period_s) for name, gripper in grippers.items()}
        at = {joint: index for index, joint in enumerate(self.robot.joints)}
        self.places = {name: np.array([at[joint] for joint in joints]) for name, joints in self.robot.controllers.items()}
        self.command = self.robot.home.copy()
        self.references = {}
        #: Commands on their way: when they arrive (s), controller, message.
        self.waiting: deque = deque()
        self.emergency = None
        #: The robot's clock minus the monotonic clock, and the robot's clock at the first update. `run` sets them.
        self.base_ns = self.begin_clock_ns = 0
        self.unread, self.low_tick = "", 0
        self.overruns, self.late_max_s = 0, 0.0
        self.wire = Wire(args.domain, args.interface, args.best_effort, [*self.robot.controllers, *self.hands],
                         hands.described(self.robot.urdf, grippers), args.commands)
        if args.encoders:
            encoders.Comparison(args.commands, self.wire.kind)
        self.trace = csv.writer(args.trace.open("w", buffering=1)) if args.trace else None
        if self.trace:
            fingers = [joint for hand in self.hands.values() for joint in hand.joints]
            columns = [f"{joint}.{what}" for joint in self.robot.joints + fingers for what in ("reference", "measured")]
            self.trace.writerow(["monotonic_s", "robot_clock_s", *columns])

    def run(self) -> None:
        """Updates on a grid of the monotonic clock. The controllers read the time of the grid, as a robot in time would."""
        print(f"ready on domain {self.args.domain}: {', '.join(self.controllers)}", flush=True)
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
        # A collection of all that set-up made takes 30 ms, and a robot does not pause. What follows makes few cycles.
        gc.collect()
        gc.freeze()
        begin_ns = time.monotonic_ns()
        self.base_ns = time.time_ns() - begin_ns
        self.begin_clock_ns = self.base_ns + begin_ns
        tick = 0
        while self.args.seconds is None or tick * self.period_s < self.args.seconds:
            due_ns = begin_ns + round(tick * self.period_s * NS_PER_S)
            late_s = (time.monotonic_ns() - due_ns) / NS_PER_S
            if late_s < 0:
                time.sleep(-late_s)
            elif late_s > self.period_s:
                self.overruns, self.late_max_s = self.overruns + 1, max(self.late_max_s, late_s)
                if late_s > LATE_MAX_S:
                    print(f"{late_s:.1f} s behind real time. Give this process more of a core.", file=sys.stderr)
                    sys.exit(os.EX_TEMPFAIL)
            if not self.update(tick, due_ns):
                break
            tick += 1

    def update(self, tick: int, monotonic_ns: int) -> bool:
        """One cycle of the controller manager: read, update, write. False once the standard input says the end."""
        now_s = tick * self.period_s
        clock_ns = self.base_ns + monotonic_ns + round((self.faults.value("clock", now_s) or 0) * NS_PER_S)
        self.receive(now_s, clock_ns)
        emergency = self.faults.active("emergency", now_s)
        for name, controller in self.controllers.items():
            if self.faults.active("inactive", now_s, name):
                # A controller that becomes active again holds the measured position.
                controller.curve = controller.incoming = None
                continue
            self.references[name] = controller.update(clock_ns, self.body.position[self.places[name]])
            if not emergency:
                self.command[self.places[name]] = self.references[name].positions
        for name, hand in self.hands.items():
            hand.update(clock_ns, self.faults.active("inactive", now_s, name), emergency)
        if emergency != self.emergency or tick % (self.args.update_hz // EMERGENCY_HZ) == 0:
            self.press_emergency(emergency, now_s, clock_ns)
        states_due = tick % (self.args.update_hz // self.state_hz) == 0
        if states_due:
            self.publish(now_s, clock_ns, monotonic_ns)
        self.body.move(self.command, self.period_s)
        self.judge.observe(now_s, self.command, self.body)
        for hand in self.hands.values():
            hand.fingers.move(hand.command, self.period_s)
            hand.judge.observe(now_s, hand.command)
        return not (states_due and self.args.stdin) or self.read_faults(now_s)

    def receive(self, now_s: float, clock_ns: int) -> None:
        """Gives each controller the commands that arrived before this update was due, however late this process is."""
        for name in [*self.controllers, *self.hands]:
            for message in self.wire.take(name):
                traffic = self.traffic(name)
                traffic.received += 1
                info, message = message.sample_info, self.content(message)
                delay_s = self.faults.delay_s(now_s, name)
                if delay_s is None:
                    traffic.lost += 1
                    continue
                sent_s = (info.source_timestamp - self.begin_clock_ns) / NS_PER_S
                # A sender on another machine has another clock. Then only the time of this update is known.
                arrival_s = sent_s if now_s < sent_s < now_s + LATE_MAX_S else now_s
                if self.args.commands == "arm_sdk":
                    message.sent_s = sent_s
                self.waiting.append((arrival_s + delay_s, name, message))
        for _ in range(len(self.waiting)):
            arrival_s, name, message = self.waiting.popleft()
            if arrival_s > now_s:
                self.waiting.append((arrival_s, name, message))
                continue
            controller = self.hands[name].controller if name in self.hands else self.controllers[name]
            controller.joints = self.joints_of(name, now_s)
            inactive = self.faults.active("inactive", now_s, name)
            reason = "controller inactive" if inactive else controller.receive(message, clock_ns)
            self.traffic(name).arrived(now_s, reason)

    def traffic(self, name: str):
        return self.hands[name].judge.traffic if name in self.hands else self.judge.traffic[name]

    def content(self, message):
        return message.data if self.args.commands == "positions" else message

    def joints_of(self, name: str, now_s: float) -> list[str]:
        joints = self.hands[name].joints if name in self.hands else self.robot.controllers[name]
        return [f"other_{joint}" for joint in joints] if self.faults.active("names", now_s, name) else joints

    def press_emergency(self, pressed: bool, now_s: float, clock_ns: int) -> None:
        """Brakes hold the joints where they are. On release the controllers hold that posture. Both are assumptions."""
        if pressed and not self.emergency:
            self.command = self.body.position.copy()
        if self.emergency and not pressed:
            for name, controller in self.controllers.items():
                controller.hold(clock_ns, self.body.position[self.places[name]])
        for hand in self.hands.values():
            hand.press(pressed, self.emergency, clock_ns)
        self.emergency = pressed
        if self.faults.active("unwatched", now_s):
            self.wire.leave_emergency()
        elif self.args.commands != "arm_sdk" and not self.faults.active("partition", now_s):
            self.wire.publish_emergency(pressed)

    def publish(self, now_s: float, clock_ns: int, monotonic_ns: int) -> None:
        position, velocity, zeros = self.body.position, self.body.velocity, [0.0] * len(self.robot.others)
        for name in [*self.controllers, *self.hands]:
            self.wire.set_second_publisher(name, self.faults.active("second", now_s, name))
        if self.trace:
            commands, measured = ([first, *(getattr(part, what) for part in parts)] for first, what, parts in (
                (self.command, "command", self.hands.values()), (position, "position", [hand.fingers for hand in self.hands.values()])))
            pairs = zip(np.concatenate(commands).round(9).tolist(), np.concatenate(measured).round(9).tolist())
            clock_s = clock_ns / NS_PER_S
            self.trace.writerow([f"{monotonic_ns / NS_PER_S:.9f}", f"{clock_s:.9f}", *(value for pair in pairs for value in pair)])
        if self.faults.active("partition", now_s):
            return
        stamp_ns = clock_ns + round((self.faults.value("stamps", now_s) or 0) * NS_PER_S)
        if self.faults.active("velocities", now_s):
            velocity = np.full(len(position), np.nan)
        if self.args.commands == "arm_sdk":
            self.wire.publish_low_state(self.low_state(position, velocity, now_s))
            return
        names, values = self.robot.joints + self.robot.others, [[*position, *zeros], [*velocity, *zeros], [*self.body.torque, *zeros]]
        for hand in self.hands.values():
            names = names + hand.joints
            for own, more in zip(values, (hand.fingers.position, hand.fingers.velocity, hand.fingers.effort)):
                own.extend(more)
        self.wire.publish_joint_states(stamp_ns, names, *values)
        for name, hand in self.hands.items():
            if hand.reference and not self.faults.active("inactive", now_s, name):
                self.wire.publish_controller_state(name, clock_ns, self.joints_of(name, now_s), hand.reference, hand.fingers.position)
        for name, reference in self.references.items():
            if name in self.wire.states and not self.faults.active("inactive", now_s, name):
                self.wire.publish_controller_state(name, clock_ns, self.joints_of(name, now_s), reference, position[self.places[name]])

    def low_state(self, position, velocity, now_s: float) -> bytes:
        motors = np.zeros((2, len(arm_sdk.JOINTS)))
        places = [arm_sdk.JOINTS.index(joint) for joint in self.robot.joints]
        motors[0, places], motors[1, places] = position, velocity
        other = self.faults.active("names", now_s)
        # Its counter stands while the state is stale.
        stands = self.faults.active("stale", now_s)
        self.low_tick = self.low_tick if stands else round(1e3 * now_s) + 1
        mode_machine = arm_sdk.MODE_MACHINE + 1 if other else arm_sdk.MODE_MACHINE
        return unitree.pack_state(mode_machine, self.low_tick, *motors.tolist())

    def read_faults(self, now_s: float) -> bool:
        """A fault on each line of the standard input, or `clear`. Its end ends the peer."""
        # A buffered reader would keep a second line to itself.
        while select.select([sys.stdin.fileno()], [], [], 0)[0]:
            read = os.read(sys.stdin.fileno(), 4096)
            if not read:
                return False
            *lines, self.unread = (self.unread + read.decode()).split("\n")
            for line in lines:
                try:
                    self.faults.all = [] if line.strip() == "clear" else [*self.faults.all, faults.parse(line, now_s)]
                except ValueError as error:
                    print(error, file=sys.stderr, flush=True)
        return True

    def report(self) -> dict:
        weights = {name: one.report() for name, one in self.controllers.items() if hasattr(one, "report")}
        return {"arm_sdk": weights, "physics": not self.args.no_physics, "contacts_judged": self.body.sees_contacts,
                "contacts_unchecked": self.body.unchecked, "seed": self.args.seed, "overruns": self.overruns,
                "late_max_ms": round(1e3 * self.late_max_s, 1), **self.judge.report(),
                "hands": {name: hand.judge.report() for name, hand in self.hands.items()}}


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robot", type=Path, default=ROBOT, help="robot file: controllers, limits, home")
    parser.add_argument("--urdf", type=Path, help="the robot as its manufacturer describes it (default: the robot file's)")
    parser.add_argument("--meshes", type=Path, help="folder that holds the files that the URDF names")
    parser.add_argument("--domain", type=int, default=0, help="DDS domain")
    parser.add_argument("--interface", help="network interface, for example lo (default: Cyclone DDS chooses)")
    parser.add_argument("--best-effort", action="store_true", help="read commands as a robot on Fast DDS does")
    parser.add_argument("--commands", choices=["trajectories", "positions", "arm_sdk"], default="trajectories",
                        help="interface of the controllers; arm_sdk is a Unitree G1 that updates at 250 Hz")
    parser.add_argument("--encoders", action="store_true", help="compare bytes with other encoders; needs rosbags")
    parser.add_argument("--update-hz", type=int, default=100, help="updates of the controllers: 50, 100, 200, 250, 500 or 1000")
    parser.add_argument("--no-physics", action="store_true", help="joints are where they are commanded; needs no MuJoCo")
    parser.add_argument("--object-width-m", type=float, default=0.0, help="an object of this width is between the fingers of each gripper")
    parser.add_argument("--without-fingers", action="store_true", help="the robot has no grippers, whatever the robot file says")
    parser.add_argument("--lag-ms", type=float, default=0.0, help="lag of the joints without physics")
    parser.add_argument("--joint-friction", action="store_true", help="keep friction and damping of the URDF's joints")
    parser.add_argument("--feed-forward", type=float, default=0.0, help="share of the commanded velocity that the drives know")
    parser.add_argument("--servo-hz", type=float, help="every joint is a critically damped servo of this frequency at home "
                        "(default: the stiffnesses of mujoco_menagerie, where a shoulder swings)")
    parser.add_argument("--ignored", action="append", default=list(body.NO_PARTS), metavar="LINK", help="a link that touches nothing")
    parser.add_argument("--allowed", action="append", default=[], metavar="LINK,LINK", help="two links that may touch")
    parser.add_argument("--seconds", type=float, help="end after so long (default: never)")
    parser.add_argument("--report", type=Path, help="write the judgement here, JSON")
    parser.add_argument("--trace", type=Path, help="write reference and measured positions here at 50 Hz, CSV")
    parser.add_argument("--picture", type=Path, help="draw the last posture's collision shapes here, PNG; needs --meshes and EGL")
    parser.add_argument("--fault", action="append", default=[], help=faults.GRAMMAR)
    parser.add_argument("--stdin", action="store_true", help="read faults from the standard input, and end with it")
    parser.add_argument("--seed", type=int, default=1, help="seed of the faults")
    args = parser.parse_args()
    if args.commands == "arm_sdk":
        args.update_hz = max(args.update_hz, LOW_STATE_HZ)
    if args.update_hz % STATE_HZ or body.STEP_HZ % args.update_hz:
        parser.error(f"--update-hz is a multiple of {STATE_HZ} that divides {body.STEP_HZ}")
    if args.picture and (args.no_physics or not args.meshes):
        parser.error("--picture needs --meshes and the physics")
    return args


def main() -> None:
    args = arguments()
    peer = Peer(args)
    try:
        peer.run()
    except KeyboardInterrupt:
        pass
    finally:
        if args.picture:
            peer.body.picture(args.picture)
        text = json.dumps(peer.report(), indent=1)
        if args.report:
            args.report.write_text(text + "\n")
        else:
            print(text)


if __name__ == "__main__":
    main()
