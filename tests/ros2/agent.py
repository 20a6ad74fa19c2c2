"""An agent for rclpy, written from msgs/PROTOCOL.md: takes so many parts at a station and says how each delivery ended.

Prints one line for each delivery and, when all went well, "all delivered".
"""

import sys

import rclpy
from geometry_msgs.msg import Pose
from minifactory_msgs.action import DeliverPart
from minifactory_msgs.msg import Factsheet
from minifactory_msgs.srv import Pick, ReportHandover
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

PRESENTED = 5
DELIVERED = 0
TAKEN, NOT_TAKEN, RELEASED = 0, 1, 2


class Agent(Node):
    def __init__(self, feeder, station):
        super().__init__("agent", namespace=station)
        self.station, self.facts, self.presented = station, None, None
        latched = QoSProfile(
            depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL, reliability=ReliabilityPolicy.RELIABLE
        )
        self.create_subscription(Factsheet, f"/{feeder}/factsheet", self.hear_facts, latched)
        self.deliver = ActionClient(self, DeliverPart, f"/{feeder}/deliver_part")
        self.report = self.create_client(ReportHandover, f"/{feeder}/report_handover")
        self.pick = self.create_client(Pick, f"/{station}/pick")

    def hear_facts(self, facts):
        self.facts = facts

    def hear_feedback(self, message):
        if message.feedback.phase == PRESENTED:
            self.presented = message.feedback

    def until(self, condition):
        while not condition():
            rclpy.spin_once(self, timeout_sec=0.1)

    def answer(self, future):
        self.until(future.done)
        return future.result()

    def get_ready(self):
        self.until(lambda: self.facts is not None)
        if self.facts.protocol_version.split(".")[0] != "3":
            sys.exit(f"the feeder speaks version {self.facts.protocol_version}")
        for there in (self.deliver.server_is_ready, self.report.service_is_ready, self.pick.service_is_ready):
            self.until(there)

    def take_part(self):
        self.presented = None
        goal = DeliverPart.Goal(station=self.station, tolerance_m=0.001, timeout_s=300.0)
        handle = self.answer(self.deliver.send_goal_async(goal, feedback_callback=self.hear_feedback))
        if not handle.accepted:
            sys.exit("the goal was rejected")
        result = handle.get_result_async()
        self.until(lambda: self.presented is not None or result.done())
        if self.presented is not None:
            delivery = self.presented.delivery_id
            fact = next(fact for fact in self.facts.stations if fact.name == self.station)
            tool = Pose(position=fact.tool_in_platen)
            opening_m = 0.01
            grip = self.answer(
                self.pick.call_async(
                    Pick.Request(station=self.station, tool_in_platen=tool, gripper_opening_m=opening_m)
                )
            )
            first = TAKEN if grip.picked else NOT_TAKEN
            for number, what in ((1, first), (2, RELEASED)):
                self.answer(
                    self.report.call_async(
                        ReportHandover.Request(delivery_id=delivery, sequence=number, report=what, message=grip.message)
                    )
                )
        return self.answer(result).result


def main():
    feeder, station, parts = sys.argv[1], sys.argv[2], int(sys.argv[3])
    rclpy.init()
    agent = Agent(feeder, station)
    agent.get_ready()
    delivered = 0
    # A part may turn or slide on its way: then the agent asks again, as the protocol says.
    for attempt in range(2 * parts):
        result = agent.take_part()
        delivered += result.outcome == DELIVERED
        print(f"{attempt + 1}: outcome {result.outcome} {result.reason}", flush=True)
        if delivered == parts:
            print("all delivered", flush=True)
            break
    rclpy.shutdown()


main()
