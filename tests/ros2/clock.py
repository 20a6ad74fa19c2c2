"""A node on simulated time: prints "simulated time passes" when its own clock has gone on by a second."""

import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter

rclpy.init()
node = Node("on_simulated_time", parameter_overrides=[Parameter("use_sim_time", value=True)])
first_ns = None
while True:
    rclpy.spin_once(node, timeout_sec=0.1)
    now_ns = node.get_clock().now().nanoseconds
    # Wall time would be decades.
    if first_ns is None and 0 < now_ns < 10**14:
        first_ns = now_ns
    if first_ns is not None and now_ns > first_ns + 10**9:
        print("simulated time passes", flush=True)
        break
rclpy.shutdown()
