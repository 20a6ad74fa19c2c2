"""Runs nodes against the wall clock, does them harm while the courier moves, and prints what it did: a row for each harm.

    python3 wall_clock.py --feeder target/debug/feeder [HARM...]

Needs PyPI's `cyclonedds` 11.0.1. A HARM is a kind of `attack.py`, `kill:NODE`, `flood:goals` and `flood:waveform` (what cannot be
read), `flood:halt` (what can), `foreign` (publishers of our topics with other types and qualities), or `emergency_stop`, which is
none: so long it takes to stand. Each node is run by `feeder node --restart`. What the courier does is told by `joint_states`,
100 times a second; ghosts are participants that are still known 5 s after, and run no more.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import dataclass

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, "..", "interop"))
# As the nodes: on this host alone. Nothing is said of what cannot be read.
os.environ["CYCLONEDDS_URI"] = (
    "<General><Interfaces><NetworkInterface name='lo' multicast='false'/></Interfaces></General>"
    "<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>"
    "<Peers><Peer address='localhost'/></Peers></Discovery><Tracing><OutputFile>/dev/null</OutputFile></Tracing>"
)

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsParticipant
from cyclonedds.core import Policy, Qos
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float64, int64, sequence, uint8, uint64
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from partner_agent import FeederState
from ros import BEST_EFFORT, LATCHED, RELIABLE, Header, Peer, Service

from attack import KINDS
from under_attack import usage

NODES = ["courier_driver", "waveform_generator", "part_simulator", "vision_selector", "delivery_planner", "overhead_manipulator"]
FLOODS = {
    "goals": ("rq/feeder/follow_joint_trajectory/_action/send_goalRequest", "control_msgs::action::dds_::FollowJointTrajectory_SendGoal_Request_"),
    "halt": ("rq/feeder/haltRequest", "std_srvs::srv::dds_::Trigger_Request_"),
    "waveform": ("rt/feeder/waveform", "minifactory_msgs::msg::dds_::Waveform_"),
}
HARMS = ["emergency_stop"] + [f"kill:{node}" for node in NODES] + [f"flood:{name}" for name in FLOODS] + ["foreign"] + [kind for kind in KINDS if kind != "flood"]
# Harm is done when it is fast.
STANDS_M_S, MOVES_M_S, FAST_M_S = 0.005, 0.05, 0.3


@dataclass
class JointState(IdlStruct, typename="sensor_msgs::msg::dds_::JointState_"):
    header: Header
    name: sequence[str]
    position: sequence[float64]
    velocity: sequence[float64]
    effort: sequence[float64]


@dataclass
class Transition(IdlStruct, typename="lifecycle_msgs::msg::dds_::Transition_"):
    id: uint8
    label: str


@dataclass
class Request(IdlStruct, typename="lifecycle_msgs::srv::dds_::ChangeState_Request_"):
    client: uint64
    number: int64
    transition: Transition


@dataclass
class Response(IdlStruct, typename="lifecycle_msgs::srv::dds_::ChangeState_Response_"):
    client: uint64
    number: int64
    success: bool


@dataclass
class StopRequest(IdlStruct, typename="std_srvs::srv::dds_::Trigger_Request_"):
    client: uint64
    number: int64
    nothing: uint8


@dataclass
class StopResponse(IdlStruct, typename="std_srvs::srv::dds_::Trigger_Response_"):
    client: uint64
    number: int64
    success: bool
    message: str


@dataclass
class Other(IdlStruct, typename="std_msgs::msg::dds_::String_"):
    data: str


class Watch:
    """What the courier does and what the planner says, with the time at which it was heard."""

    def __init__(self, peer):
        self.speeds, self.states, self.ends = [], [], False
        self.joints = DataReader(peer.participant, Topic(peer.participant, "rt/feeder/joint_states", JointState), qos=RELIABLE)
        self.state = DataReader(peer.participant, Topic(peer.participant, "rt/feeder/state", FeederState), qos=LATCHED)
        threading.Thread(target=self.listen, daemon=True).start()

    def listen(self):
        while not self.ends:
            now = time.monotonic()
            for sample in self.joints.take(N=100):
                if hasattr(sample, "velocity"):
                    self.speeds.append((now, (sample.velocity[0] ** 2 + sample.velocity[1] ** 2) ** 0.5))
            for sample in self.state.take(N=100):
                if hasattr(sample, "message"):
                    self.states.append((now, sample.message))
            time.sleep(0.002)

    def first(self, holds, since, patience):
        """Seconds from `since` until a speed for which `holds` is true, or None."""
        while True:
            when = next((at for at, speed in self.speeds if at >= since and holds(speed)), None)
            if when is not None or time.monotonic() > since + patience:
                return None if when is None else when - since
            time.sleep(0.005)


def foreign(peer, until):
    """Publishers of our topics with another type, and with another quality."""
    writers = [
        DataWriter(peer.participant, Topic(peer.participant, f"rt/feeder/{topic}", Other), qos=qos)
        for topic in ["waveform", "odometry", "courier_state", "delivery_state", "part_candidates", "tray_motion"]
        for qos in [RELIABLE, BEST_EFFORT, Qos(Policy.Reliability.BestEffort, Policy.Deadline(1000))]
    ]
    count = 0
    while time.monotonic() < until:
        for writer in writers:
            writer.write(Other("harm" * 20))
            count += 1
        time.sleep(0.0005)
    return count


def child(process):
    with open(f"/proc/{process.pid}/task/{process.pid}/children") as children:
        return next(map(int, children.read().split()), None)


def row(harm, arguments):
    environment = {key: value for key, value in os.environ.items() if not key.startswith("ROS_")}
    environment |= dict(ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST", ROS_DOMAIN_ID=str(arguments.domain), NO_COLOR="1")
    log = tempfile.TemporaryFile("w+")
    run = lambda node: subprocess.Popen([arguments.feeder, "node", node, "--restart"], env=environment, stdin=subprocess.DEVNULL, stdout=log, stderr=log)
    nodes = {node: run(node) for node in NODES}
    peer = Peer(arguments.domain, 60.0)
    watch = Watch(peer)
    try:
        change = Service(peer, "/feeder/courier_driver/change_state", Request, Response)
        for number in [1, 3]:
            assert change.call(Transition(number, "")).success
        stop = Service(peer, "/feeder/emergency_stop", StopRequest, StopResponse)
        assert watch.first(lambda speed: speed > FAST_M_S, time.monotonic(), 60) is not None, "the courier never moves"
        participants = BuiltinDataReader(peer.participant, BuiltinTopicDcpsParticipant)
        known = lambda: len({str(sample.key) for sample in participants.read(N=500) if sample.sample_info.instance_state == 16})
        before = known()
        sizes = lambda: sum(usage(process.pid)[0] for process in nodes.values())
        mib, began = [sizes()], time.monotonic()
        sent = "1 kill"
        if harm == "emergency_stop":
            sent = "1 call"
            stop.ask(0)
        elif harm.startswith("kill:"):
            os.kill(child(nodes[harm[5:]]), signal.SIGKILL)
        elif harm == "foreign":
            sent = f"{foreign(peer, began + arguments.seconds)} samples"
        else:
            kind, _, name = harm.partition(":")
            command = [sys.executable, f"{HERE}/attack.py", "--domain", str(arguments.domain), "--seconds", str(arguments.seconds)]
            command += ["--rate", "10000", "--participants", "8", kind]
            if name:
                command += ["--topic", FLOODS[name][0], "--type", FLOODS[name][1]]
            attacker = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
            largest = 0.0
            while attacker.poll() is None:
                largest = max(largest, sizes())
                time.sleep(0.02)
            mib.append(largest)
            said = json.loads(attacker.communicate()[0])
            sent = f"{said['messages'] / said['seconds']:.0f} a second to each"
        over = time.monotonic()
        time.sleep(5)
        mib.append(sizes())
        ghosts = known() - before
        during = [(at, speed) for at, speed in watch.speeds if began <= at <= over + 5]
        times = [began, *(at for at, _ in during), over + 5]
        silence = max(later - earlier for earlier, later in zip(times, times[1:]))
        stood = watch.first(lambda speed: speed < STANDS_M_S, began, 0)
        again = watch.first(lambda speed: speed > MOVES_M_S, max(over, began + (stood or 0.0)), arguments.patience)
        names = list(dict.fromkeys(text for at, text in watch.states if at >= began and text))
        alive = [node for node, process in nodes.items() if process.poll() is None and child(process)]
        figure = lambda value, form: "-" if value is None else format(value, form)
        print(
            f"{harm:26s} {sent:22s} {figure(stood and 1e3 * stood, '6.0f'):>6s} {1e3 * silence:8.0f} {max((speed for _, speed in during), default=0):8.3f} "
            f"{figure(again, '6.1f'):>6s}  {'/'.join(f'{size:.0f}' for size in mib):12s} {ghosts:3d} {len(alive)} of {len(nodes)}",
            flush=True,
        )
        for text in names[:3]:
            print(f"    state: {text[:150]}", flush=True)
    finally:
        watch.ends = True
        for process in nodes.values():
            process.terminate()
        for process in nodes.values():
            process.wait(20)
        log.seek(0)
        for line in [line for line in log.read().splitlines() if "started again" in line or "allocation" in line or " ERROR " in line][:4]:
            print(f"    {line[:170]}", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("harms", nargs="*", default=HARMS, metavar="HARM")
    parser.add_argument("--feeder", required=True)
    parser.add_argument("--domain", type=int, default=46)
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--patience", type=float, default=20.0, help="seconds to wait until the courier moves again")
    arguments = parser.parse_args()
    arguments.feeder = os.path.abspath(arguments.feeder)
    print("harm                       sent                   stood ms  silent ms  m/s  moves again s  MiB  ghosts  running")
    for harm in arguments.harms:
        try:
            row(harm, arguments)
        except (AssertionError, SystemExit) as error:
            print(f"{harm:26s} not tried: {error}", flush=True)


if __name__ == "__main__":
    main()
