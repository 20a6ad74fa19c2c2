"""Writes what commands of the ros2 CLI send to the node `/test/echo`, and what they must get, as `tests/data/cli.txt`.

Which requests a command makes is taken from ros2cli and rclpy (Jazzy): `ros2 param list` asks for all names, `get`,
`set` and `describe` for one, `dump` for all names and then all values, `load` sets what the file says one by one;
`ros2 action send_goal --feedback` sends a goal, asks for its result at once and hears feedback; an interrupt cancels it.
The bytes are written by rosbags from the definitions in `msgs`, so that none of this project's own code is in them.
Times that a node chooses are `.` and match anything.

    python cli_sequences.py > ../data/cli.txt      needs `pip install rosbags==0.11.9`
"""

import sys
from pathlib import Path

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys.base import normalize_fieldname

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "msgs" / "tests"))
from check_hashes import read_store  # noqa: E402

STORE = read_store()
NODE = "/test/echo"
ACTION = "/test/deliver/_action"
RCL = "rcl_interfaces"
BOOL, INTEGER, DOUBLE, STRING, DOUBLES = 1, 2, 3, 4, 8


def default(desc):
    kind, inner = desc
    if kind == Nodetype.NAME:
        return make(inner)
    if kind == Nodetype.BASE:
        return {"string": "", "bool": False}.get(inner[0], 0.0 if inner[0].startswith("float") else 0)
    element, size = inner
    if element[0] == Nodetype.BASE and element[1][0] != "string":
        name = {"byte": "uint8", "char": "uint8"}.get(element[1][0], element[1][0])
        return np.zeros(size if kind == Nodetype.ARRAY else 0, dtype=name)
    return [default(element) for _ in range(size if kind == Nodetype.ARRAY else 0)]


def make(name, /, **values):
    """A message with these values and zeros elsewhere."""
    fields = {field: default(desc) for field, desc in STORE.fielddefs[name][1]}
    if name == "geometry_msgs/msg/Quaternion":
        fields["w"] = 1.0  # the only default in use that is not zero
    assert fields.keys() >= values.keys(), (name, values)
    fields = {**fields, **values}
    return STORE.types[name](**{normalize_fieldname(field): value for field, value in fields.items()})


def cdr(name, /, **values):
    return bytes(STORE.serialize_cdr(make(name, **values), name, little_endian=True)).hex()


def dds(name):
    package, folder, kind = name.split("/")
    return f"{package}::{folder}::dds_::{kind}_"


class Script:
    def __init__(self):
        self.numbers = {}
        self.kinds = {}

    def client(self, name, service, kind):
        self.kinds[name] = kind
        request, reply = dds(f"{kind}_Request"), dds(f"{kind}_Response")
        print(f"client {name} rq{service}Request {request} rr{service}Reply {reply}")

    def exchange(self, name, request, response):
        number = self.ask(name, **request)
        self.expect(name, number, **response)

    def ask(self, name, /, **request):
        number = self.numbers[name] = self.numbers.get(name, 0) + 1
        print(f"call {name} {number} {cdr(self.kinds[name] + '_Request', **request)}")
        return number

    def expect(self, name, number, mask=None, **response):
        text = cdr(self.kinds[name] + "_Response", **response)
        print(f"reply {name} {number} {mask(text) if mask else text}")


def value(kind, content=None):
    field = {
        BOOL: "bool_value",
        INTEGER: "integer_value",
        DOUBLE: "double_value",
        STRING: "string_value",
        DOUBLES: "double_array_value",
    }
    values = {"type": kind}
    if kind == DOUBLES:
        content = np.array(content, dtype=np.float64)
    if kind:
        values[field[kind]] = content
    return make(f"{RCL}/msg/ParameterValue", **values)


def parameter(name, *content):
    return make(f"{RCL}/msg/Parameter", name=name, value=value(*content))


def result(reason=""):
    return make(f"{RCL}/msg/SetParametersResult", successful=not reason, reason=reason)


def descriptor(name, kind, description, constraints="", read_only=True, limits=None):
    ranges = [make(f"{RCL}/msg/FloatingPointRange", from_value=limits[0], to_value=limits[1])] if limits else []
    return make(
        f"{RCL}/msg/ParameterDescriptor",
        name=name,
        type=kind,
        description=description,
        additional_constraints=constraints,
        read_only=read_only,
        floating_point_range=ranges,
    )


def uuid(number):
    return make("unique_identifier_msgs/msg/UUID", uuid=np.full(16, number, dtype=np.uint8))


PARAMETERS = {
    "log_level": (STRING, "info"),
    "name": (STRING, "demo"),
    "places_m": (DOUBLES, [0.1, 0.25]),
    "rate_hz": (DOUBLE, 10.0),
    "start_type_description_service": (BOOL, True),
    "use_sim_time": (BOOL, False),
}


def parameters(script):
    for name, service, kind in [
        ("list", "list_parameters", "ListParameters"),
        ("get", "get_parameters", "GetParameters"),
        ("types", "get_parameter_types", "GetParameterTypes"),
        ("describe", "describe_parameters", "DescribeParameters"),
        ("set", "set_parameters", "SetParameters"),
    ]:
        script.client(name, f"{NODE}/{service}", f"{RCL}/srv/{kind}")
    names = make(f"{RCL}/msg/ListParametersResult", names=list(PARAMETERS))
    print("# ros2 param list /test/echo")
    script.exchange("list", {}, {"result": names})
    print("# ros2 param list --param-type /test/echo")
    script.exchange("list", {}, {"result": names})
    script.exchange(
        "types",
        {"names": list(PARAMETERS)},
        {"types": np.array([kind for kind, _ in PARAMETERS.values()], dtype=np.uint8)},
    )
    print("# ros2 param get /test/echo rate_hz")
    script.exchange("get", {"names": ["rate_hz"]}, {"values": [value(DOUBLE, 10.0)]})
    print("# ros2 param get /test/echo nothing")
    script.exchange("get", {"names": ["nothing"]}, {"values": [value(0)]})
    print("# ros2 param set /test/echo rate_hz 25.0")
    script.exchange("set", {"parameters": [parameter("rate_hz", DOUBLE, 25.0)]}, {"results": [result()]})
    print("# ros2 param get /test/echo rate_hz")
    script.exchange("get", {"names": ["rate_hz"]}, {"values": [value(DOUBLE, 25.0)]})
    print("# ros2 param set /test/echo rate_hz 1000.0")
    refusal = result("parameter rate_hz: 1000.0 is not in 0.5 … 100.0")
    script.exchange("set", {"parameters": [parameter("rate_hz", DOUBLE, 1000.0)]}, {"results": [refusal]})
    print("# ros2 param set /test/echo rate_hz 25")
    refusal = result("parameter rate_hz: 25 is not a double (write 1.0, not 1)")
    script.exchange("set", {"parameters": [parameter("rate_hz", INTEGER, 25)]}, {"results": [refusal]})
    print("# ros2 param set /test/echo name other")
    refusal = result("parameter name is read-only: it can be set at the start of the node")
    script.exchange("set", {"parameters": [parameter("name", STRING, "other")]}, {"results": [refusal]})
    print("# ros2 param describe /test/echo rate_hz name")
    described = [
        descriptor("rate_hz", DOUBLE, "How often, in hertz", read_only=False, limits=(0.5, 100.0)),
        descriptor("name", STRING, "From the scenario"),
    ]
    script.exchange("describe", {"names": ["rate_hz", "name"]}, {"descriptors": described})
    print("# ros2 param dump /test/echo")
    now = {**PARAMETERS, "rate_hz": (DOUBLE, 25.0)}
    script.exchange("list", {}, {"result": names})
    script.exchange("get", {"names": list(now)}, {"values": [value(*content) for content in now.values()]})
    print("# ros2 param load /test/echo with what was dumped, and rate_hz 10.0")
    loaded = [parameter(name, *content) for name, content in PARAMETERS.items()]
    script.exchange("set", {"parameters": loaded}, {"results": [result() for _ in loaded]})
    script.exchange("get", {"names": ["rate_hz"]}, {"values": [value(DOUBLE, 10.0)]})


def types(script):
    name = "minifactory_msgs/srv/ReportHandover"
    script.client("types_of", f"{NODE}/get_type_description", "type_description_interfaces/srv/GetTypeDescription")
    print("# a tool asks what a type is, by another hash than the node's")
    reason = f'type {name}_Request has the hash {STORE.hash_rihs01(name + "_Request")} here, not "RIHS01_00"'
    script.exchange(
        "types_of",
        {"type_name": f"{name}_Request", "type_hash": "RIHS01_00", "include_type_sources": True},
        {"successful": False, "failure_reason": reason},
    )
    print("# and by the right one")
    field = lambda name, kind: make(  # noqa: E731
        "type_description_interfaces/msg/Field",
        name=name,
        type=make("type_description_interfaces/msg/FieldType", type_id=kind),
    )
    described = make(
        "type_description_interfaces/msg/IndividualTypeDescription",
        type_name=f"{name}_Request",
        fields=[field(*entry) for entry in REPORT_FIELDS],
    )
    script.exchange(
        "types_of",
        {"type_name": f"{name}_Request", "type_hash": STORE.hash_rihs01(name + "_Request"), "include_type_sources": False},
        {
            "successful": True,
            "type_description": make("type_description_interfaces/msg/TypeDescription", type_description=described),
        },
    )


def report_fields():
    numbers = {"string": 17, "bool": 15, "uint8": 3, "uint32": 7}
    fields = STORE.fielddefs["minifactory_msgs/srv/ReportHandover_Request"][1]
    return [(name, numbers[desc[1][0]]) for name, desc in fields]


REPORT_FIELDS = report_fields()
DELIVER = "minifactory_msgs/action/DeliverPart"


def accepted(text):
    """A goal is accepted at a time that the node chooses: the last eight bytes."""
    return text[: -2 * 8] + "." * 16


def actions(script):
    script.client("send_goal", f"{ACTION}/send_goal", f"{DELIVER}_SendGoal")
    script.client("cancel", f"{ACTION}/cancel_goal", "action_msgs/srv/CancelGoal")
    script.client("get_result", f"{ACTION}/get_result", f"{DELIVER}_GetResult")
    feedback = f"{DELIVER}_FeedbackMessage"
    print(f"reader feedback rt{ACTION}/feedback {dds(feedback)} reliable volatile")

    def goal(number, station, steps):
        content = make(f"{DELIVER}_Goal", station=station, part_class="grommet", tolerance_m=0.001, timeout_s=steps)
        number = script.ask("send_goal", goal_id=uuid(number), goal=content)
        script.expect("send_goal", number, mask=accepted, accepted=True)

    def finished(number, status, station):
        ended = make(f"{DELIVER}_Result", outcome=0 if status == 4 else 1, reason=station)
        script.expect("get_result", number, status=status, result=ended)

    print('# ros2 action send_goal --feedback /test/deliver minifactory_msgs/action/DeliverPart "{station: station_1, ...}"')
    goal(1, "station_1", 3.0)
    number = script.ask("get_result", goal_id=uuid(1))
    for left in (2.0, 1.0, 0.0):
        said = make(f"{DELIVER}_Feedback", eta_s=left, delivery_id="station_1")
        print(f"sample feedback {cdr(feedback, goal_id=uuid(1), feedback=said)}")
    finished(number, 4, "station_1")
    print("# the same, interrupted: the goal is cancelled")
    goal(2, "station_2", 0.0)
    number = script.ask("get_result", goal_id=uuid(2))
    info = make("action_msgs/msg/GoalInfo", goal_id=uuid(2))
    asked = script.ask("cancel", goal_info=info)
    script.expect("cancel", asked, mask=accepted, return_code=0, goals_canceling=[info])
    finished(number, 5, "station_2")
    print("# cancelled once more, and a goal that never was")
    script.exchange("cancel", {"goal_info": info}, {"return_code": 3})
    script.exchange("cancel", {"goal_info": make("action_msgs/msg/GoalInfo", goal_id=uuid(9))}, {"return_code": 2})


def main():
    print("# What the ros2 CLI sends to /test/echo and must get, by tests/interop/cli_sequences.py.")
    script = Script()
    parameters(script)
    types(script)
    actions(script)


if __name__ == "__main__":
    main()
