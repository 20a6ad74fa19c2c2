#!/usr/bin/env python3
"""Speed and error of MuJoCo and of this project's mechanics on the same work, in the same run.

The work: one point part at r = 85 mm under the waveform of Fig. 15 (9.0 and 66.7 times m rad/s^2, m = 0.2 * 9.81,
T = 1/30 s), on the ramp and on the plateau of the paper's tray. MuJoCo gets the tray, its ramp in convex sectors ("tray"), and for an
easier time the local slope alone, a tilted box that accelerates horizontally ("slope"); a part is a sphere that cannot
turn. Each step has the mean acceleration of the waveform. It runs in its own C loop (mujoco.rollout), one thread. Both
programs run here, one after the other.

    python3 -m venv VENV && VENV/bin/pip install -r tests/mujoco/requirements.txt
    cargo build --release && VENV/bin/python tests/mujoco/compare.py

Prints a table; see --help for the settings. Speeds are part-seconds computed per second of wall time, the best of several
runs; errors are those of the feed against the exact engine on the ideal waveform, and against the exact engine on the
accelerations that MuJoCo was given, which separates the integration from the sampling.
"""

import argparse
import json
import math
import pathlib
import subprocess
import tempfile
import time

import mujoco
import mujoco.rollout
import numpy as np

PERIOD_S = 1.0 / 30.0
GRAVITY = 9.81
MU = 0.2
RADIUS_M = 0.085
A_MIN = 9.0 * MU * GRAVITY * RADIUS_M
A_MAX = 66.7 * MU * GRAVITY * RADIUS_M
SLOPES_DEG = {"ramp": math.degrees(math.atan(0.02 / math.pi / RADIUS_M)), "plateau": 0.0}
TRAY_KG = 1000.0

REPOSITORY = pathlib.Path(__file__).resolve().parents[2]
LAB = REPOSITORY / "target/release/feeder-lab"

OPTIONS = """
  <option timestep="{step}" gravity="0 0 -{gravity}" cone="elliptic" impratio="10" solver="Newton" integrator="Euler"/>
  <default><geom friction="{mu} 0 0" solref="0.002 1" solimp="0.99 0.999 0.0001" condim="3" contype="1" conaffinity="2"/>
  </default>"""
# The local slope: a tilted box that accelerates along x.
SLOPE = """
<mujoco>{options}
  <worldbody>
    <body name="tray"><joint name="tray" type="slide" axis="1 0 0"/>
      <geom type="box" size="1 1 .05" euler="0 {tilt} 0" pos="{below_x} 0 {below_z}" mass="0"/>
      <inertial pos="0 0 0" mass="{inertia}" diaginertia="1 1 1"/>
    </body>
    {parts}
  </worldbody>
  <actuator><motor joint="tray" gear="{inertia}"/></actuator>
</mujoco>
"""
# The annular tray: convex sectors for the ramp, a box for the plateau, turning about z.
TRAY = """
<mujoco>{options}
  <asset>{meshes}</asset>
  <worldbody>
    <body name="tray"><joint name="tray" type="hinge" axis="0 0 1"/>
      {sectors}
      <geom type="box" size=".1 .05 .005" pos="0 -.05 .015" mass="0"/>
      <inertial pos="0 0 0" mass="1" diaginertia="{inertia} {inertia} {inertia}"/>
    </body>
    {parts}
  </worldbody>
  <actuator><motor joint="tray" gear="{inertia}"/></actuator>
</mujoco>
"""
PART = """
    <body pos="{x} {y} {z}"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><joint type="slide" axis="0 0 1"/>
      <geom type="sphere" size="{ball}" mass="0.001" contype="2" conaffinity="1"/></body>
"""
# The catalogue's block, 6 x 4 x 3 mm, free to tumble and to touch others.
BLOCK = """
    <body pos="{x} {y} {z}" euler="0 0 {yaw}"><freejoint/>
      <geom type="box" size=".003 .002 .0015" density="7900" contype="3" conaffinity="3"/></body>
"""
BALL_M = 0.001
SECTORS = 60
RINGS = 6
RISE_M = 0.02


def segments():
    """Durations and accelerations of the waveform."""
    forward_s = A_MAX * PERIOD_S / (2.0 * (A_MIN + A_MAX))
    return [(forward_s, A_MIN), (PERIOD_S - 2.0 * forward_s, -A_MAX), (forward_s, A_MIN)]


def velocity(time_s):
    """Velocity of the tray, of zero mean over the period: it starts at rest by symmetry."""
    left = math.fmod(time_s, PERIOD_S)
    speed = 0.0
    for duration_s, acceleration in segments():
        passed = min(left, duration_s)
        speed += passed * acceleration
        left -= passed
    return speed


def sampled(steps):
    """Mean acceleration of each of the steps of a period."""
    edges = [velocity(i * PERIOD_S / steps) for i in range(steps)]
    edges.append(edges[0])
    return [(after - before) * steps / PERIOD_S for before, after in zip(edges, edges[1:])]


def lab(*arguments):
    """JSON that the feeder-lab command prints."""
    command = [LAB, *map(str, arguments)]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def exact_feed(pieces, slope_deg):
    """Feed of the exact engine for (duration, acceleration) pieces, m/s."""
    with tempfile.NamedTemporaryFile("w", suffix=".yaml") as file:
        rows = (f"  - {{duration_s: {d!r}, acceleration: {a!r}}}\n" for d, a in pieces)
        file.write("axis: x\nsegments:\n" + "".join(rows))
        file.flush()
        return lab("feed-rate", "--waveform", file.name, "--mu", MU, "--slope-deg", slope_deg)["feed_m_s"]


def slope_model(slope_deg, step_s, parts):
    """The local slope as MuJoCo text. The box rises towards x; its top passes through the origin."""
    slope_rad = math.radians(slope_deg)
    balls = "".join(PART.format(x=0, y=0.01 * i, z=BALL_M / math.cos(slope_rad), ball=BALL_M) for i in range(parts))
    return SLOPE.format(
        options=OPTIONS.format(step=step_s, gravity=GRAVITY, mu=MU), tilt=-slope_deg,
        below_x=0.05 * math.sin(slope_rad), below_z=-0.05 * math.cos(slope_rad), inertia=TRAY_KG, parts=balls,
    )


def tray_model(surface, step_s, parts):
    """The paper's tray as MuJoCo text, with parts in the middle of a surface."""
    # The ramp is twisted: the narrower the rings, the less the convex pieces differ from it.
    meshes, sectors = "", ""
    for i in range(SECTORS):
        for ring in range(RINGS):
            corners = []
            for angle in (math.pi * i / SECTORS, math.pi * (i + 1) / SECTORS):
                for radius in (0.03 + 0.06 * ring / RINGS, 0.03 + 0.06 * (ring + 1) / RINGS):
                    for height in (-0.01, RISE_M * angle / math.pi):
                        corners += [radius * math.cos(angle), radius * math.sin(angle), height]
            meshes += f'<mesh name="s{i}_{ring}" vertex="{" ".join(map(repr, corners))}"/>'
            sectors += f'<geom type="mesh" mesh="s{i}_{ring}" mass="0"/>'
    return TRAY.format(
        options=OPTIONS.format(step=step_s, gravity=GRAVITY, mu=MU), meshes=meshes, sectors=sectors,
        inertia=TRAY_KG, parts=blocks() if surface == "blocks" else balls(surface, parts),
    )


def balls(surface, parts):
    """Parts that cannot turn, in the middle of a surface."""
    balls = ""
    for i in range(parts):
        # Within 20 degrees of the middle, so that all stay on the surface.
        angle = (0.5 + 0.5 / SECTORS if surface == "ramp" else 1.5) * math.pi + 0.35 * (2 * i / max(parts - 1, 1) - 1) * (parts > 1)
        height = (RISE_M * angle / math.pi if surface == "ramp" else RISE_M) + 1.003 * BALL_M
        balls += PART.format(x=RADIUS_M * math.cos(angle), y=RADIUS_M * math.sin(angle), z=height, ball=BALL_M)
    return balls


def blocks():
    """Fifty blocks in two rows over ramp and plateau."""
    text = ""
    for i in range(50):
        angle = 0.15 + (i // 2) * (2.0 * math.pi - 0.3) / 24
        radius = (0.074, 0.085)[i % 2]
        height = RISE_M * min(angle / math.pi, 1.0) + 0.0018
        text += BLOCK.format(x=radius * math.cos(angle), y=radius * math.sin(angle), z=height, yaw=math.degrees(angle))
    return text


def bulk():
    """Fifty blocks in each of the three engines, simulated seconds per wall second."""
    steps, periods = 67, 15
    model = mujoco.MjModel.from_xml_string(tray_model("blocks", PERIOD_S / steps, 50))
    data = mujoco.MjData(model)
    for _ in range(100):
        mujoco.mj_step(model, data)
    state = np.zeros(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    control = np.tile(np.array(sampled(steps)) / RADIUS_M, periods).reshape(1, -1, 1)
    started = time.perf_counter()
    mujoco.rollout.rollout(model, data, state[None, :], control)
    other = periods * PERIOD_S / (time.perf_counter() - started)
    print("\n50 blocks of 6 x 4 x 3 mm, steps of 0.5 ms, simulated seconds per wall second")
    print(f"{'MuJoCo ' + mujoco.__version__:44} {other:10.3g}")
    for row in lab("bulk", "speed", "--part", "block", "--count", 50, "--rapier", "--duration", 20):
        own, rapier = row["sim_s_per_wall_s"], row["rapier3d_sim_s_per_wall_s"]
        print(f"{'rapier3d, ' + row['waveform']:44} {rapier:10.3g}")
        name = "this project, " + row["waveform"]
        print(f"{name:44} {own:10.3g}   {own / other:.3g} x MuJoCo, {own / rapier:.3g} x rapier3d")


def mujoco_run(kind, surface, steps, periods, parts, repeats):
    """Feed of the first part in m/s over the second half of the run, and part-seconds per wall second, the best of some
    repeats. The tray turns by about a milliradian: relative to it, the part's angle is its own less the tray's."""
    slope_deg, step_s = SLOPES_DEG[surface], PERIOD_S / steps
    text = slope_model(slope_deg, step_s, parts) if kind == "slope" else tray_model(surface, step_s, parts)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    state = np.zeros(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    lever = 1.0 if kind == "slope" else RADIUS_M
    control = np.tile(np.array(sampled(steps)) / lever, periods).reshape(1, -1, 1)
    best_s = math.inf
    for _ in range(repeats):
        started = time.perf_counter()
        states, _ = mujoco.rollout.rollout(model, data, state[None, :], control)
        best_s = min(best_s, time.perf_counter() - started)
    # State 0 is the time, 1 the tray, then x, y, z of the first part as displacements from where it began.
    tray, x, y = states[0, :, 1], states[0, :, 2], states[0, :, 3]
    if kind == "slope":
        travel = x - tray
    else:
        start = model.body_pos[2]
        travel = RADIUS_M * (np.unwrap(np.arctan2(start[1] + y, start[0] + x)) - tray)
    half = periods // 2 * steps
    feed = (travel[-1] - travel[half - 1]) / ((periods - periods // 2) * PERIOD_S) / math.cos(math.radians(slope_deg))
    return feed, parts * periods * PERIOD_S / best_s


def own_speeds():
    """Part-seconds per wall second of this project's engines, from their benchmarks, run now."""
    command = ["cargo", "bench", "-p", "feeder_core", "--bench", "mechanics", "--"]
    command += ["--warm-up-time", "0.5", "--measurement-time", "2"]
    subprocess.run(command, check=True, cwd=REPOSITORY, capture_output=True)
    folder = REPOSITORY / "target/criterion"
    cases = {
        "exact, 1 part": ("exact/10 s of one part", 10.0),
        **{f"2 kHz samples, {n} parts": (f"sampled at 2 kHz/vibration/{n}", 0.1 * n) for n in (1, 10, 100, 1000)},
        "2 kHz samples, 1000 parts, two threads": ("sampled at 2 kHz/vibration, two threads_1000", 100.0),
    }
    speeds = {}
    for name, (path, part_seconds) in cases.items():
        estimates = json.loads((folder / path / "new/estimates.json").read_text())
        speeds[name] = part_seconds / (estimates["median"]["point_estimate"] * 1e-9)
    return speeds


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--periods", type=int, default=60, help="periods that MuJoCo runs")
    parser.add_argument("--repeats", type=int, default=4, help="runs of which the best is taken")
    parser.add_argument("--lab", type=pathlib.Path, default=LAB, help="the feeder-lab command")
    parser.add_argument("--only-bulk", action="store_true", help="only the fifty blocks, with rapier3d as well")
    options = parser.parse_args()
    globals()["LAB"] = options.lab
    if options.only_bulk:
        bulk()
        return

    lone = {}
    print(f"MuJoCo {mujoco.__version__}")
    print(f"{'case':44} {'part-s/s':>10} {'error':>9} {'error on samples':>17}")
    for surface, slope_deg in SLOPES_DEG.items():
        ideal = exact_feed(segments(), slope_deg)
        for steps in (67, 167):
            on_samples = exact_feed([(PERIOD_S / steps, a) for a in sampled(steps)], slope_deg)
            for kind in ("tray", "slope"):
                for parts in (1, 50):
                    feed, speed = mujoco_run(kind, surface, steps, options.periods, parts, options.repeats)
                    if parts == 1 and steps == 167 and surface == "ramp":
                        lone[kind] = speed
                    name = f"MuJoCo {kind}, {surface}, {PERIOD_S / steps * 1e3:.1f} ms, {parts} part(s)"
                    print(f"{name:44} {speed:10.3g} {feed / ideal - 1:9.2%} {feed / on_samples - 1:17.2%}")
    for name, speed in own_speeds().items():
        ratios = ", ".join(f"{speed / other:.3g} x MuJoCo's {kind}" for kind, other in lone.items())
        print(f"{'this project, ' + name:44} {speed:10.3g}   {ratios} (1 part, ramp, 0.2 ms)")
    for surface, slope_deg in SLOPES_DEG.items():
        # 2 kHz: three periods are 200 samples.
        edges = [velocity(i * 5e-4) for i in range(200)]
        edges.append(edges[0])
        held = [(5e-4, (after - before) / 5e-4) for before, after in zip(edges, edges[1:])]
        change = exact_feed(held, slope_deg) / exact_feed(segments(), slope_deg) - 1
        print(f"this project, {surface}, 2 kHz samples against the ideal waveform: {change:.2%}")
    bulk()


if __name__ == "__main__":
    main()
