"""A partner agent written from msgs/PROTOCOL.md, with Eclipse Cyclone DDS alone.

It works at one station: asks the feeder for parts, closes its gripper on them (a service of the simulation), hands over
properly, and tries what must be refused. Prints one JSON object with what it has seen; whether that is right is for the
caller to judge. Only what it cannot go on without makes it fail: an answer that stays away until the deadline.
"""

import argparse
import json
import sys
import uuid
from dataclasses import dataclass, field

from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, float64, int8, int64, sequence, uint8, uint32, uint64

from ros import LATCHED, RELIABLE, Header, Peer, Service, Time

PROTOCOL_MAJOR = 3
MOVING, PRESENTED = 4, 5
TAKEN, NOT_TAKEN, RELEASED = 0, 1, 2


@dataclass
class Point(IdlStruct, typename="geometry_msgs::msg::dds_::Point_"):
    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0


@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs::msg::dds_::Quaternion_"):
    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0
    w: float64 = 1.0


@dataclass
class Pose(IdlStruct, typename="geometry_msgs::msg::dds_::Pose_"):
    position: Point = field(default_factory=Point)
    orientation: Quaternion = field(default_factory=Quaternion)


@dataclass
class UUID(IdlStruct, typename="unique_identifier_msgs::msg::dds_::UUID_"):
    uuid: array[uint8, 16]


@dataclass
class Area(IdlStruct, typename="minifactory_msgs::msg::dds_::Area_"):
    points: sequence[Point] = field(default_factory=list)
    radius_m: float64 = 0.0


@dataclass
class Recipe(IdlStruct, typename="minifactory_msgs::msg::dds_::Recipe_"):
    name: str
    part_class: str
    pose_classes: sequence[str]
    part_diameter_m: float64
    part_height_m: float64


@dataclass
class StationFact(IdlStruct, typename="minifactory_msgs::msg::dds_::StationFact_"):
    name: str
    tool_in_platen: Point
    rechecked: bool


@dataclass
class Factsheet(IdlStruct, typename="minifactory_msgs::msg::dds_::Factsheet_"):
    protocol_version: str
    feeder: str
    platen_frame: str
    tray_frame: str
    recipes: sequence[Recipe]
    recipe: str
    stations: sequence[StationFact]
    tolerance_m_min: float64
    hand_over_timeout_s: float64
    starvation_s: float64
    feeding_place: Point
    reach_min: Point
    reach_max: Point
    footprint_radius_m: float64
    speed_m_s_max: float64
    acceleration_m_s2_max: float64
    reserve_area: str


@dataclass
class FeederState(IdlStruct, typename="minifactory_msgs::msg::dds_::FeederState_"):
    header: Header
    state: uint8
    reason: uint8
    message: str
    recipe: str
    open: uint32
    stations: sequence[str]


@dataclass
class SendGoalRequest(IdlStruct, typename="minifactory_msgs::action::dds_::DeliverPart_SendGoal_Request_"):
    client: uint64
    number: int64
    goal_id: UUID
    station: str
    part_class: str
    pose_class: str
    tolerance_m: float64
    part_gap_m_min: float64
    timeout_s: float64


@dataclass
class SendGoalResponse(IdlStruct, typename="minifactory_msgs::action::dds_::DeliverPart_SendGoal_Response_"):
    client: uint64
    number: int64
    accepted: bool
    stamp: Time


@dataclass
class GetResultRequest(IdlStruct, typename="minifactory_msgs::action::dds_::DeliverPart_GetResult_Request_"):
    client: uint64
    number: int64
    goal_id: UUID


@dataclass
class Result(IdlStruct, typename="minifactory_msgs::action::dds_::DeliverPart_Result_"):
    outcome: uint8
    reason: str
    delivery_id: str
    part_id: str
    part_in_station: Pose


@dataclass
class GetResultResponse(IdlStruct, typename="minifactory_msgs::action::dds_::DeliverPart_GetResult_Response_"):
    client: uint64
    number: int64
    status: int8
    result: Result


@dataclass
class Feedback(IdlStruct, typename="minifactory_msgs::action::dds_::DeliverPart_Feedback_"):
    phase: uint8
    eta_s: float64
    delivery_id: str
    part_id: str
    part_in_station: Pose


@dataclass
class FeedbackMessage(IdlStruct, typename="minifactory_msgs::action::dds_::DeliverPart_FeedbackMessage_"):
    goal_id: UUID
    feedback: Feedback


@dataclass
class GoalInfo(IdlStruct, typename="action_msgs::msg::dds_::GoalInfo_"):
    goal_id: UUID
    stamp: Time


@dataclass
class CancelGoalRequest(IdlStruct, typename="action_msgs::srv::dds_::CancelGoal_Request_"):
    client: uint64
    number: int64
    goal_info: GoalInfo


@dataclass
class CancelGoalResponse(IdlStruct, typename="action_msgs::srv::dds_::CancelGoal_Response_"):
    client: uint64
    number: int64
    return_code: int8
    goals_canceling: sequence[GoalInfo]


@dataclass
class ReportHandoverRequest(IdlStruct, typename="minifactory_msgs::srv::dds_::ReportHandover_Request_"):
    client: uint64
    number: int64
    delivery_id: str
    sequence: uint32
    report: uint8
    message: str


@dataclass
class ReportHandoverResponse(IdlStruct, typename="minifactory_msgs::srv::dds_::ReportHandover_Response_"):
    client: uint64
    number: int64
    accepted: bool
    message: str


@dataclass
class PickRequest(IdlStruct, typename="minifactory_msgs::srv::dds_::Pick_Request_"):
    client: uint64
    number: int64
    station: str
    tool_in_platen: Pose
    gripper_opening_m: float64


@dataclass
class PickResponse(IdlStruct, typename="minifactory_msgs::srv::dds_::Pick_Response_"):
    client: uint64
    number: int64
    picked: bool
    part_id: uint32
    message: str


@dataclass
class ReserveAreaRequest(IdlStruct, typename="minifactory_msgs::srv::dds_::ReserveArea_Request_"):
    client: uint64
    number: int64
    agent: str
    lease_id: str
    area: Area
    parked: bool
    occupied: bool
    duration_s: float64
    wait_s: float64


@dataclass
class ReserveAreaResponse(IdlStruct, typename="minifactory_msgs::srv::dds_::ReserveArea_Response_"):
    client: uint64
    number: int64
    result: uint8
    lease_id: str
    expires: Time
    message: str


@dataclass
class ReleaseAreaRequest(IdlStruct, typename="minifactory_msgs::srv::dds_::ReleaseArea_Request_"):
    client: uint64
    number: int64
    agent: str
    lease_id: str


@dataclass
class ReleaseAreaResponse(IdlStruct, typename="minifactory_msgs::srv::dds_::ReleaseArea_Response_"):
    client: uint64
    number: int64
    released: bool
    message: str


@dataclass
class ChangeRecipeRequest(IdlStruct, typename="minifactory_msgs::srv::dds_::ChangeRecipe_Request_"):
    client: uint64
    number: int64
    recipe: str


@dataclass
class ChangeRecipeResponse(IdlStruct, typename="minifactory_msgs::srv::dds_::ChangeRecipe_Response_"):
    client: uint64
    number: int64
    changed: bool
    message: str


@dataclass
class PurgeRequest(IdlStruct, typename="minifactory_msgs::srv::dds_::Purge_Request_"):
    client: uint64
    number: int64
    timeout_s: float64


@dataclass
class PurgeResponse(IdlStruct, typename="minifactory_msgs::srv::dds_::Purge_Response_"):
    client: uint64
    number: int64
    purged: bool
    message: str


class Agent(Peer):
    def __init__(self, options):
        super().__init__(options.domain, options.seconds)
        self.feeder, self.station = options.feeder, options.station
        self.facts = self.collect(f"/{self.feeder}/factsheet", Factsheet, LATCHED)
        self.states = self.collect(f"/{self.feeder}/state", FeederState, LATCHED)
        action = f"/{self.feeder}/deliver_part/_action"
        self.feedback = self.collect(f"{action}/feedback", FeedbackMessage, RELIABLE)
        self.send_goal = Service(self, f"{action}/send_goal", SendGoalRequest, SendGoalResponse)
        self.get_result = Service(self, f"{action}/get_result", GetResultRequest, GetResultResponse)
        self.cancel_goal = Service(self, f"{action}/cancel_goal", CancelGoalRequest, CancelGoalResponse)
        report = f"/{self.feeder}/report_handover"
        self.report = Service(self, report, ReportHandoverRequest, ReportHandoverResponse)
        self.pick = Service(self, f"/{self.station}/pick", PickRequest, PickResponse)

    def progress(self):
        return f"phases so far: {[message.feedback.phase for message in self.feedback]}"

    def factsheet(self, recipe=None):
        """The factsheet that holds now, or the first one with a recipe in force."""
        self.wait_until("a factsheet", lambda: self.facts and recipe in (None, self.facts[-1].recipe))
        return self.facts[-1]

    def ask(self, station, tolerance_m, timeout_s=60.0, pose_class="", part_gap_m_min=0.0):
        """Asks for a part; returns the goal's identifier and whether it was accepted."""
        goal = UUID(list(uuid.uuid4().bytes))
        answer = self.send_goal.call(goal, station, "", pose_class, tolerance_m, part_gap_m_min, timeout_s)
        return goal, answer.accepted

    def phases(self, goal):
        return [message.feedback for message in self.feedback if list(message.goal_id.uuid) == list(goal.uuid)]

    def wait_for_phase(self, goal, phase):
        self.wait_until(f"phase {phase}", lambda: any(told.phase == phase for told in self.phases(goal)))
        return next(told for told in self.phases(goal) if told.phase == phase)

    def take_part(self, tool, goal):
        """One whole delivery: waits, grips, reports, and returns what happened."""
        result = self.get_result.ask(goal)
        told = self.wait_for_phase(goal, PRESENTED)
        early = self.report.call(told.delivery_id, 1, RELEASED, "")
        grip = self.pick.call(self.station, Pose(Point(tool.x, tool.y, tool.z), Quaternion()), 0.01)
        first = (told.delivery_id, 1, TAKEN if grip.picked else NOT_TAKEN, grip.message)
        taken, taken_again = self.report.call(*first), self.report.call(*first)
        misnumbered = self.report.call(told.delivery_id, 1, RELEASED, "")
        released = self.report.call(told.delivery_id, 2, RELEASED, "")
        answer = self.get_result.answer(result)
        offset = told.part_in_station.position
        return {
            "phases": [told.phase for told in self.phases(goal)],
            "etas_s": [told.eta_s for told in self.phases(goal)],
            "offset_m": [offset.x, offset.y],
            "released_early": early.accepted,
            "picked": grip.picked,
            "taken": taken.accepted,
            "taken_again": taken_again.accepted,
            "misnumbered": misnumbered.accepted,
            "released": released.accepted,
            "status": answer.status,
            "outcome": answer.result.outcome,
            "same_part": answer.result.part_id == told.part_id != "",
            "reason": answer.result.reason,
        }

    def cancel_on_the_way(self, goal):
        result = self.get_result.ask(goal)
        self.wait_for_phase(goal, MOVING)
        cancelled = self.cancel_goal.call(GoalInfo(goal, Time()))
        answer = self.get_result.answer(result)
        return {
            "return_code": cancelled.return_code,
            "phases": [told.phase for told in self.phases(goal)],
            "status": answer.status,
            "outcome": answer.result.outcome,
        }

    def leave_without_answer(self, goal):
        """Never reports: the feeder gives up."""
        result = self.get_result.ask(goal)
        told = self.wait_for_phase(goal, PRESENTED)
        answer = self.get_result.answer(result)
        late = self.report.call(told.delivery_id, 1, TAKEN, "")
        return {"status": answer.status, "outcome": answer.result.outcome, "late_report": late.accepted}

    def change_and_purge(self, facts):
        """Before anything is asked for: other recipes, and emptying the plateau."""
        change = Service(self, f"/{self.feeder}/change_recipe", ChangeRecipeRequest, ChangeRecipeResponse)
        purge = Service(self, f"/{self.feeder}/purge", PurgeRequest, PurgeResponse)
        other = facts.recipes[-1].name

        def purged_or_told_why():
            answer = purge.call(20.0)
            return answer.purged != ("still on the plateau" in answer.message)

        return {
            "unknown_recipe": change.call("nonsense").changed,
            "other_recipe": change.call(other).changed,
            "recipe_now": self.factsheet(other).recipe,
            "purged_for_no_time": purge.call(-1.0).purged,
            "purged_or_told_why": purged_or_told_why(),
            "first_recipe": change.call(facts.recipes[0].name).changed,
        }

    def claim_areas(self, facts):
        """Two agents claim one area, far from the feeder; a lease ends in time; a claim on the feeder's parking."""
        reserve = Service(self, facts.reserve_area, ReserveAreaRequest, ReserveAreaResponse)
        release_area = facts.reserve_area.replace("reserve", "release")
        release = Service(self, release_area, ReleaseAreaRequest, ReleaseAreaResponse)
        corner = Area([Point(facts.reach_max.x, facts.reach_max.y, 0.0)], 0.05)
        parking = Area([facts.feeding_place], 0.05)

        def claim(agent, area, duration_s, wait_s, lease=""):
            return reserve.call(agent, lease, area, False, False, duration_s, wait_s)

        # Long enough for the second claim to come in time on a busy machine.
        first = claim("partner_a", corner, 15.0, 0.0)
        second = claim("partner_b", corner, 60.0, 0.2)
        after_expiry = claim("partner_b", corner, 60.0, 60.0)
        renewed_late = claim("partner_a", Area(), 60.0, 0.0, first.lease_id)
        negative = claim("partner_a", corner, -1.0, 0.0)
        parked = claim("partner_a", parking, 60.0, 30.0)
        stolen = release.call("partner_a", after_expiry.lease_id)
        released = release.call("partner_b", after_expiry.lease_id)
        results = {
            "first": first,
            "second": second,
            "after_expiry": after_expiry,
            "renewed_late": renewed_late,
            "negative": negative,
            "parked": parked,
        }
        claims = {name: {"result": answer.result, "message": answer.message} for name, answer in results.items()}
        return {"claims": claims, "stolen": stolen.released, "released": released.released}


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--domain", type=int, required=True)
    parser.add_argument("--feeder", default="feeder")
    parser.add_argument("--station", default="station_1", help="the station this agent works at")
    parser.add_argument("--pose", required=True, help="resting pose to ask for")
    parser.add_argument("--seconds", type=float, required=True, help="give up after so long")
    options = parser.parse_args()
    agent = Agent(options)

    facts = agent.factsheet()
    major = int(facts.protocol_version.split(".")[0])
    if major != PROTOCOL_MAJOR:
        sys.exit(f"the feeder speaks version {facts.protocol_version}, this agent {PROTOCOL_MAJOR}")
    tool = next(station.tool_in_platen for station in facts.stations if station.name == options.station)
    tolerance_m = max(0.0005, facts.tolerance_m_min)

    refused = {
        "unknown station": agent.ask("nowhere", tolerance_m)[1],
        "negative tolerance": agent.ask(options.station, -0.001)[1],
        "tolerance too fine": agent.ask(options.station, facts.tolerance_m_min / 2)[1],
        "unknown pose": agent.ask(options.station, tolerance_m, pose_class="upside down")[1],
        "negative gap": agent.ask(options.station, tolerance_m, part_gap_m_min=-0.001)[1],
    }
    prepared = agent.change_and_purge(facts)
    areas = agent.claim_areas(facts)
    ask = lambda: agent.ask(options.station, tolerance_m, pose_class=options.pose)[0]
    report = {
        "version": facts.protocol_version,
        "recipes": [recipe.name for recipe in facts.recipes],
        "stations": [station.name for station in facts.stations],
        "refused": refused,
        "prepared": prepared,
        "areas": areas,
        "delivered": agent.take_part(tool, ask()),
        "cancelled": agent.cancel_on_the_way(ask()),
        "silent": agent.leave_without_answer(ask()),
        "delivered_after_all": agent.take_part(tool, ask()),
        "states": sorted({state.state for state in agent.states}),
    }
    json.dump(report, sys.stdout)


if __name__ == "__main__":
    main()
