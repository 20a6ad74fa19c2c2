"""Runs the suite, attacks it, and prints what became of it: a row for each kind of attack.

    python3 under_attack.py --feeder target/debug/feeder [--range LOCALHOST] [--seconds 5] [KIND...]

Memory and CPU are those of all processes of the run, before, during and in the seconds after the attack.
"""

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import time

from attack import KINDS

HERE = os.path.dirname(os.path.abspath(__file__))
TICK = os.sysconf("SC_CLK_TCK")


def processes(root):
    """The process and its children."""
    with open(f"/proc/{root}/task/{root}/children") as children:
        return [root, *map(int, children.read().split())]


def usage(root):
    """Resident memory of all, of the largest, MiB, and CPU time of all, s."""
    memory, cpu = [], 0.0
    try:
        everybody = processes(root)
    except OSError:
        return 0, 0, 0.0
    for process in everybody:
        try:
            with open(f"/proc/{process}/status") as status:
                memory.append(int(re.search(r"VmRSS:\s+(\d+)", status.read())[1]) / 1024)
            with open(f"/proc/{process}/stat") as stat:
                fields = stat.read().rsplit(") ", 1)[1].split()
                cpu += (int(fields[11]) + int(fields[12])) / TICK
        except (OSError, TypeError):
            pass
    return sum(memory), max(memory, default=0), cpu


def watch(run, seconds, until=None):
    """CPU share and highest memory in the next seconds, or until a process has ended."""
    began, first, highest, largest = time.monotonic(), usage(run.pid)[2], 0, 0
    while time.monotonic() < began + seconds and run.poll() is None and (until is None or until.poll() is None):
        total, most, _ = usage(run.pid)
        highest, largest = max(highest, total), max(largest, most)
        time.sleep(0.05)
    took = max(time.monotonic() - began, 1e-3)
    return dict(mib=round(highest), largest_mib=round(largest), cpu=round(max(0.0, usage(run.pid)[2] - first) / took, 2))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kinds", nargs="*", default=KINDS)
    parser.add_argument("--feeder", required=True)
    parser.add_argument("--range", default="LOCALHOST")
    parser.add_argument("--domain", type=int, default=47)
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--rate", type=float, default=2000.0)
    parser.add_argument("--after", type=float, default=5.0, help="seconds to look on after the attack")
    parser.add_argument("--speed", default="1")
    arguments = parser.parse_args()
    print("kind              datagrams  MiB before/during/after  largest  CPU before/during/after  factor  end")
    for kind in arguments.kinds or KINDS:
        row(kind, arguments)


def row(kind, arguments):
    environment = dict(os.environ, ROS_AUTOMATIC_DISCOVERY_RANGE=arguments.range, ROS_DOMAIN_ID=str(arguments.domain), NO_COLOR="1")
    with tempfile.TemporaryDirectory() as folder:
        log = open(f"{folder}/log", "w+")
        command = [arguments.feeder, "up", "--plain", "--speed", arguments.speed, "--duration", "600", "--summary", f"{folder}/s.json"]
        run = subprocess.Popen(command, env=environment, stdout=log, stderr=log, stdin=subprocess.DEVNULL)
        time.sleep(4)
        before = watch(run, 3)
        attack = [sys.executable, f"{HERE}/attack.py", "--domain", str(arguments.domain), "--seconds", str(arguments.seconds)]
        attacker = subprocess.Popen([*attack, "--rate", str(arguments.rate), kind], stdout=subprocess.PIPE, text=True)
        began = time.monotonic()
        during = watch(run, arguments.seconds + 60, attacker)
        lived = time.monotonic() - began
        said = json.loads(attacker.communicate()[0])
        ended = time.monotonic()
        after = watch(run, arguments.after)
        took = time.monotonic() - ended
        end = "runs"
        if run.poll() is not None:
            # It is looked on until the run or the attack has ended.
            end = f"ended within {lived + took:.1f} s of its first message"
        else:
            run.terminate()
            try:
                run.wait(20)
            except subprocess.TimeoutExpired:
                run.kill()
                end = "does not end"
        log.seek(0)
        errors = [line for line in log.read().splitlines() if "rror" in line or "memory allocation" in line]
        summary = json.load(open(f"{folder}/s.json")) if os.path.exists(f"{folder}/s.json") else {}
    three = lambda key: "/".join(str(part[key]) for part in (before, during, after))
    print(f"{kind:16s} {said['datagrams']:9d}  {three('mib'):22s} {during['largest_mib']:8d}  {three('cpu'):24s} factor {summary.get('real_time_factor', 0):.2f}  {end}", flush=True)
    for line in errors[-2:]:
        print("    " + line[:200], flush=True)


if __name__ == "__main__":
    main()
