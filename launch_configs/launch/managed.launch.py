"""Starts the nodes of a feeder apart, against the wall clock, and leads them through their lifecycles in order.

Needs `feeder` and `ros2` on the PATH. A node becomes active when the one before it has: what a node hears comes before it.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, RegisterEventHandler
from launch.event_handlers import OnProcessExit
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution, ThisLaunchFileDir

# In the order in which they become active: the courier stands still until the planner asks for something.
MANAGED = ["part_simulator", "courier_driver", "waveform_generator", "vision_selector", "delivery_planner"]
AGENTS = ["overhead_manipulator"]
# How often a transition is tried before the node is given up; a try takes a second or more.
TRIES_MAX = 30


def start(name, *ros_args):
    command = ["feeder", "node", name, "--config", LaunchConfiguration("scenario"), *ros_args]
    return ExecuteProcess(name=name, cmd=command, output="screen")


def lead(name, transition):
    """Makes the transition as soon as the node is there, and gives up when it does not come."""
    node = f"/feeder/{name}"
    command = f"""
        trap 'exit 130' INT TERM
        for _ in $(seq {TRIES_MAX}); do
          ros2 lifecycle set {node} {transition} && exit
          sleep 0.2
        done
        echo {node} has not come up
        exit 1"""
    return ExecuteProcess(name=f"{transition}_{name}", cmd=["bash", "-c", command], output="screen")


def generate_launch_description():
    scenario = PathJoinSubstitution([ThisLaunchFileDir(), "..", "default.yaml"])
    declared = DeclareLaunchArgument("scenario", default_value=scenario, description="Scenario (YAML)")
    nodes = [start(name, "--ros-args", "-p", "autostart:=false") for name in MANAGED]
    steps = [lead(name, transition) for transition in ("configure", "activate") for name in MANAGED]
    in_order = [
        RegisterEventHandler(OnProcessExit(target_action=step, on_exit=[following]))
        for step, following in zip(steps, steps[1:])
    ]
    return LaunchDescription([declared, *nodes, *map(start, AGENTS), *in_order, steps[0]])
