"""Holds the generated types against the Python package rosbags, which reads definitions, hashes types and writes CDR.

    python check_hashes.py                  compare the hash of every type
    python check_hashes.py --golden FILE    write a CDR sample of every message type, for the Rust tests

The definitions are read from their files, so nothing but the names is taken from the Rust side.
Needs `pip install rosbags==0.11.9` and cargo.
"""

import argparse
import random
import subprocess
import sys
from pathlib import Path

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.base import normalize_fieldname
from rosbags.typesys.store import TIDMAP

ROOT = Path(__file__).resolve().parent.parent
OWN_PACKAGE = "minifactory_msgs"

# ROS 2 makes a `char` a `uint8` before it hashes; rosbags does not. The hashes that ROS 2 publishes for services, all of
# which contain the char[16] of ServiceEventInfo, are in the Rust tests.
TIDMAP["char"] = TIDMAP["uint8"]

BOOL = (Nodetype.BASE, ("bool", 0))
INT8 = (Nodetype.BASE, ("int8", 0))
UUID = (Nodetype.NAME, "unique_identifier_msgs/msg/UUID")
TIME = (Nodetype.NAME, "builtin_interfaces/msg/Time")
EVENT_INFO = (Nodetype.NAME, "service_msgs/msg/ServiceEventInfo")


def named(name):
    return (Nodetype.NAME, name)


def at_most_one(name):
    return (Nodetype.SEQUENCE, (named(name), 1))


def service(name):
    """Event and service, as ROS 2 derives them from request and response."""
    request, response, event = (f"{name}_{part}" for part in ("Request", "Response", "Event"))
    return {
        event: [("info", EVENT_INFO), ("request", at_most_one(request)), ("response", at_most_one(response))],
        name: [
            ("request_message", named(request)),
            ("response_message", named(response)),
            ("event_message", named(event)),
        ],
    }


def action(name):
    """Everything that ROS 2 derives from goal, result and feedback."""
    goal, result, feedback = (f"{name}_{part}" for part in ("Goal", "Result", "Feedback"))
    return {
        f"{name}_SendGoal_Request": [("goal_id", UUID), ("goal", named(goal))],
        f"{name}_SendGoal_Response": [("accepted", BOOL), ("stamp", TIME)],
        f"{name}_GetResult_Request": [("goal_id", UUID)],
        f"{name}_GetResult_Response": [("status", INT8), ("result", named(result))],
        f"{name}_FeedbackMessage": [("goal_id", UUID), ("feedback", named(feedback))],
        **service(f"{name}_SendGoal"),
        **service(f"{name}_GetResult"),
        name: [
            ("goal", named(goal)),
            ("result", named(result)),
            ("feedback", named(feedback)),
            ("send_goal_service", named(f"{name}_SendGoal")),
            ("get_result_service", named(f"{name}_GetResult")),
            ("feedback_message", named(f"{name}_FeedbackMessage")),
        ],
    }


SECTIONS = {"msg": [""], "srv": ["_Request", "_Response"], "action": ["_Goal", "_Result", "_Feedback"]}
DERIVE = {"msg": lambda name: {}, "srv": service, "action": action}


def read_package(package, folder):
    """All types of a package: name to (constants, fields)."""
    types = {}
    for kind, suffixes in SECTIONS.items():
        for file in sorted(folder.glob(f"{kind}/*.{kind}")):
            sections = [""]
            for line in file.read_text().splitlines():
                if line == "---":
                    sections.append("")
                else:
                    sections[-1] += line + "\n"
            for suffix, text in zip(suffixes, sections, strict=True):
                parsed_as = f"{package}/msg/{file.stem}{suffix}"
                types[f"{package}/{kind}/{file.stem}{suffix}"] = get_types_from_msg(text, parsed_as)[parsed_as]
            for name, fields in DERIVE[kind](f"{package}/{kind}/{file.stem}").items():
                types[name] = ([], fields)
    return types


def read_store():
    """A type store of the definitions in this package."""
    types = read_package(OWN_PACKAGE, ROOT)
    for folder in sorted((ROOT / "standard").iterdir()):
        types.update(read_package(folder.name, folder))
    store = get_typestore(Stores.EMPTY)
    store.register(types)
    return store


def rust_hashes():
    command = ["cargo", "run", "--quiet", "--package", OWN_PACKAGE, "--example", "hashes"]
    output = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    return dict(line.split() for line in output.splitlines())


def check_hashes():
    bundled = get_typestore(Stores.ROS2_JAZZY)
    store = read_store()
    rust = rust_hashes()
    wrong = [f"{name}: no Rust type" for name in store.fielddefs if name not in rust and not name.endswith("_Event")]
    from_bundled = 0
    for name, found in rust.items():
        expected = store.hash_rihs01(name) if name in store.fielddefs else "not in the definitions"
        if found != expected:
            wrong.append(f"{name}: {found}, expected {expected}")
        if name in bundled.fielddefs:
            from_bundled += 1
            if found != bundled.hash_rihs01(name):
                wrong.append(f"{name}: {found}, in Jazzy {bundled.hash_rihs01(name)}")
    for line in wrong:
        print(line, file=sys.stderr)
    print(f"{len(rust)} types, {from_bundled} of them bundled with rosbags for Jazzy, {len(wrong)} wrong")
    return 1 if wrong else 0


class Samples:
    """Arbitrary but repeatable values."""

    def __init__(self, store):
        self.store = store
        self.random = random.Random(1)

    def primitive(self, name):
        if name == "string":
            return "".join(self.random.choice("aZ_/ é0") for _ in range(self.random.randint(1, 5)))
        if name == "bool":
            return self.random.random() < 0.5
        if name.startswith("float"):
            return float(np.dtype(name).type(self.random.uniform(-1e3, 1e3)))
        if name == "byte":
            return self.random.randrange(128)  # rosbags packs a byte as a signed number
        limits = np.iinfo("uint8" if name == "char" else name)
        return self.random.randint(int(limits.min), int(limits.max))

    def value(self, desc):
        kind, inner = desc
        if kind == Nodetype.BASE:
            return self.primitive(inner[0])
        if kind == Nodetype.NAME:
            return self.message(inner)
        element, size = inner
        count = size if kind == Nodetype.ARRAY else self.random.randint(1, min(size or 2, 2))
        values = [self.value(element) for _ in range(count)]
        if element[0] == Nodetype.BASE and element[1][0] != "string":
            name = element[1][0]
            return np.array(values, dtype="uint8" if name in ("byte", "char") else name)
        return values

    def message(self, name):
        fields = self.store.fielddefs[name][1]
        values = {normalize_fieldname(field): self.value(desc) for field, desc in fields}
        return self.store.types[name](**values)


def write_golden(path):
    store = read_store()
    samples = Samples(store)
    with open(path, "w", encoding="ascii") as file:
        for name in sorted(store.fielddefs):
            is_interface = any(f"{name}_{part}" in store.fielddefs for part in ("Event", "FeedbackMessage"))
            if is_interface or name.endswith("_Event"):
                continue
            cdr = bytes(4)
            while not any(cdr[4:]):  # all zeros are no sample
                cdr = bytes(store.serialize_cdr(samples.message(name), name, little_endian=True))
            file.write(f"{name} {cdr.hex()}\n")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--golden", metavar="FILE", help="write CDR samples instead of comparing hashes")
    arguments = parser.parse_args()
    if arguments.golden:
        write_golden(arguments.golden)
        return 0
    return check_hashes()


if __name__ == "__main__":
    sys.exit(main())
