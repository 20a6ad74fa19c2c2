"""Runs a scenario in simulated time. Needs `feeder` on the PATH; ends when the run ends."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, Shutdown
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution, ThisLaunchFileDir

HERE = ThisLaunchFileDir()
ARGUMENTS = {
    "scenario": (PathJoinSubstitution([HERE, "..", "default.yaml"]), "Scenario, or plan of a run that was (YAML)"),
    "speed": ("1", "Simulated seconds per wall second: a positive number, or max"),
    "duration": ("3600", "Simulated seconds to run, instead of the scenario's"),
}


def generate_launch_description():
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, (default, description) in ARGUMENTS.items()
    ]
    options = [text for name in ARGUMENTS for text in (f"--{name}", LaunchConfiguration(name))]
    run = ExecuteProcess(
        name="feeder", cmd=["feeder", "up", "--plain", *options], output="screen", on_exit=Shutdown()
    )
    layout = PathJoinSubstitution([HERE, "..", "viewers", "feeder.rviz"])
    rviz = ExecuteProcess(
        cmd=["rviz2", "-d", layout], output="screen", condition=IfCondition(LaunchConfiguration("rviz"))
    )
    shown = DeclareLaunchArgument("rviz", default_value="false", description="Whether to show the run in RViz")
    return LaunchDescription([*declared, shown, run, rviz])
