"""Holds the golden CDR samples of `msgs/tests/data/cdr.txt` against Eclipse Cyclone DDS.

Every message type is made anew from its definition as a Cyclone type; its sample is read by Cyclone's decoder and
written again by its encoder, and must come out as it was, byte for byte.
"""

import re
import sys
from pathlib import Path

from cyclonedds.idl import make_idl_struct
from cyclonedds.idl.types import array, float32, float64, int8, int16, int32, int64, sequence, uint8, uint16, uint32, uint64

MSGS = Path(__file__).resolve().parents[2] / "msgs"
PRIMITIVES = {
    "bool": bool,
    "byte": uint8,
    "char": uint8,
    "float32": float32,
    "float64": float64,
    "int8": int8,
    "uint8": uint8,
    "int16": int16,
    "uint16": uint16,
    "int32": int32,
    "uint32": uint32,
    "int64": int64,
    "uint64": uint64,
}
SECTIONS = {"msg": [""], "srv": ["_Request", "_Response"], "action": ["_Goal", "_Result", "_Feedback"]}
UUID, TIME = "unique_identifier_msgs/msg/UUID", "builtin_interfaces/msg/Time"


def wrappers(name):
    """What ROS 2 wraps around goal, result and feedback."""
    return {
        f"{name}_SendGoal_Request": [(UUID, "goal_id"), (f"{name}_Goal", "goal")],
        f"{name}_SendGoal_Response": [("bool", "accepted"), (TIME, "stamp")],
        f"{name}_GetResult_Request": [(UUID, "goal_id")],
        f"{name}_GetResult_Response": [("int8", "status"), (f"{name}_Result", "result")],
        f"{name}_FeedbackMessage": [(UUID, "goal_id"), (f"{name}_Feedback", "feedback")],
    }


def read_fields(package, text):
    """Type and name of each field; constants, comments and default values are left out."""
    fields = []
    for line in text.splitlines():
        words = line.split("#")[0].split()
        if len(words) < 2 or "=" in re.sub(r"<=\d+", "", "".join(words[:3])):
            continue
        kind, name = words[:2]
        element = re.match(r"[\w/]+", kind)[0]
        if element not in PRIMITIVES and element not in ("string", "wstring"):
            owner, short = element.split("/") if "/" in element else (package, element)
            # A header needs no package, which nothing else does without.
            owner = "std_msgs" if element == "Header" and package != "std_msgs" else owner
            kind = kind.replace(element, f"{owner}/msg/{short}", 1)
        fields.append((kind, name))
    return fields


def read_definitions():
    definitions = {}
    packages = [("minifactory_msgs", MSGS), *((folder.name, folder) for folder in (MSGS / "standard").iterdir())]
    for package, folder in packages:
        for kind, suffixes in SECTIONS.items():
            for file in folder.glob(f"{kind}/*.{kind}"):
                name = f"{package}/{kind}/{file.stem}"
                parts = re.split(r"^---\s*$", file.read_text(), flags=re.MULTILINE)
                for suffix, text in zip(suffixes, parts, strict=True):
                    definitions[name + suffix] = read_fields(package, text)
                if kind == "action":
                    definitions.update(wrappers(name))
    return definitions


class Types:
    def __init__(self):
        self.definitions = read_definitions()
        self.made = {}

    def struct(self, name):
        if name not in self.made:
            fields = {field: self.field(kind) for kind, field in self.definitions[name]}
            # A message without fields has one in ROS 2.
            fields = fields or {"structure_needs_at_least_one_member": uint8}
            self.made[name] = make_idl_struct(name.replace("/", "_"), name.replace("/", "::"), fields)
        return self.made[name]

    def field(self, kind):
        element, bounds = re.fullmatch(r"([\w/]+)(?:<=\d+)?(\[.*\])?", kind).groups()
        kind = str if element == "string" else PRIMITIVES.get(element) or self.struct(element)
        if bounds is None:
            return kind
        size = bounds[1:-1]
        if size.isdigit():
            return array[kind, int(size)]
        return sequence[kind, int(size[2:])] if size else sequence[kind]


def main():
    types = Types()
    wrong, count = [], 0
    for line in (MSGS / "tests" / "data" / "cdr.txt").read_text().splitlines():
        name, sample = line.split()
        sample = bytes.fromhex(sample)
        kind = types.struct(name)
        try:
            again = kind.deserialize(sample).serialize(use_version_2=False)
        except Exception as error:  # whatever the decoder stumbles over
            again = str(error).encode()
        count += 1
        if again != sample:
            wrong.append(f"{name}: {sample.hex()} became {again.hex()}")
    print(f"{count} types, {len(wrong)} wrong")
    if wrong:
        sys.exit("\n".join(wrong))


if __name__ == "__main__":
    main()
