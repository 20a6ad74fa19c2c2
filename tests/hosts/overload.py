"""How long a request takes, and how many are lost, while somebody else floods the same service: ours beside Cyclone DDS's.

    python3 overload.py --feeder target/debug/feeder [--rate 1000 10000] [--calls 300]

Needs PyPI's `cyclonedds` 11.0.1. Ours is a parameter service of a node in a running suite; the other is a server in Python that
does the same work, in a process of its own (its interpreter is part of what is timed). The flood comes from a process of its own too. Prints a row for each.
"""

import argparse
import multiprocessing
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "interop"))

from cyclonedds.core import Listener
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import int64, sequence, uint8, uint64
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from ros import RELIABLE, Peer, Service

OURS, OTHERS = "/feeder/courier_driver/get_parameter_types", "/cyclone/get_parameter_types"
# How long an answer is waited for, and how long calls are made for one row.
PATIENCE_S, ROW_S = 2.0, 30.0


@dataclass
class Request(IdlStruct, typename="rcl_interfaces::srv::dds_::GetParameterTypes_Request_"):
    client: uint64
    number: int64
    names: sequence[str]


@dataclass
class Response(IdlStruct, typename="rcl_interfaces::srv::dds_::GetParameterTypes_Response_"):
    client: uint64
    number: int64
    types: sequence[uint8]


def serve(domain, stop):
    participant = DomainParticipant(domain)
    writer = DataWriter(participant, Topic(participant, f"rr{OTHERS}Reply", Response), qos=RELIABLE)

    class Answer(Listener):
        def on_data_available(self, reader):
            for request in reader.take(N=100):
                if hasattr(request, "client"):
                    writer.write(Response(request.client, request.number, [1 for _ in request.names]))

    reader = DataReader(participant, Topic(participant, f"rq{OTHERS}Request", Request), qos=RELIABLE, listener=Answer())
    stop.wait()
    del reader


def flood(domain, name, rate, stop, sent):
    participant = DomainParticipant(domain)
    writer = DataWriter(participant, Topic(participant, f"rq{name}Request", Request), qos=RELIABLE)
    while not writer.get_matched_subscriptions() and not stop.is_set():
        time.sleep(0.01)
    began, number = time.monotonic(), 0
    while not stop.is_set():
        number += 1
        try:
            writer.write(Request(7, number, ["use_sim_time"]))
        except Exception:
            pass
        ahead = began + number / rate - time.monotonic()
        if ahead > 0.001:
            time.sleep(ahead)
    sent.value = number / (time.monotonic() - began)


def calls(peer, name, count):
    """Times of answers in ms, and how many never came; within ROW_S."""
    service, times, lost = Service(peer, name, Request, Response), [], 0
    # The server knows the client when it has answered once.
    peer.deadline = time.monotonic() + 60
    while not service.answers:
        service.ask(["use_sim_time"])
        until = time.perf_counter() + 0.2
        while not service.answers and time.perf_counter() < until:
            for reply in service.reader.take(N=100):
                if getattr(reply, "client", None) == service.client:
                    service.answers[reply.number] = reply
    end = time.perf_counter() + ROW_S
    for _ in range(count):
        if time.perf_counter() > end:
            break
        peer.deadline = time.monotonic() + 60
        began = time.perf_counter()
        number = service.ask(["use_sim_time"])
        while number not in service.answers and time.perf_counter() < began + PATIENCE_S:
            for reply in service.reader.take(N=100):
                if getattr(reply, "client", None) == service.client:
                    service.answers[reply.number] = reply
        if service.answers.pop(number, None) is None:
            lost += 1
        else:
            times.append(1e3 * (time.perf_counter() - began))
        time.sleep(0.005)
    return sorted(times), lost


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--feeder", required=True)
    parser.add_argument("--domain", type=int, default=48)
    parser.add_argument("--rate", type=float, nargs="+", default=[1_000.0, 10_000.0])
    parser.add_argument("--calls", type=int, default=300)
    arguments = parser.parse_args()
    environment = {key: value for key, value in os.environ.items() if not key.startswith("ROS_")}
    with tempfile.TemporaryFile() as log:
        command = [arguments.feeder, "up", "--plain", "--speed", "1", "--duration", "600", "--domain", str(arguments.domain)]
        run = subprocess.Popen(command, env=environment, stdin=subprocess.DEVNULL, stdout=log, stderr=log)
        context = multiprocessing.get_context("spawn")
        stop = context.Event()
        server = context.Process(target=serve, args=(arguments.domain, stop))
        server.start()
        try:
            peer = Peer(arguments.domain, 60.0)
            print("server   flood, requests/s  calls  lost  p50 ms  p99 ms  largest ms")
            for rate in [0.0, *arguments.rate]:
                for who, name in [("ours", OURS), ("Cyclone", OTHERS)]:
                    end, sent = context.Event(), context.Value("d", 0.0)
                    flooder = context.Process(target=flood, args=(arguments.domain, name, rate, end, sent))
                    if rate:
                        flooder.start()
                        time.sleep(2)
                    times, lost = calls(peer, name, arguments.calls)
                    end.set()
                    if rate:
                        flooder.join(10)
                    at = lambda share: times[min(len(times) - 1, int(share * len(times)))] if times else float("nan")
                    print(f"{who:7s}  {sent.value:17.0f}  {len(times) + lost:5d}  {lost:4d}  {at(0.5):6.2f}  {at(0.99):6.2f}  {at(1.0):10.2f}", flush=True)
            print("the suite", "runs" if run.poll() is None else f"has ended: {run.returncode}")
        finally:
            stop.set()
            server.join(5)
            run.terminate()
            run.wait(30)


if __name__ == "__main__":
    main()
