#!/usr/bin/python3
"""Latency of an exchange (free velocity out, link force in) for clients in C++, C and Python, idle and on busy cores.

Example: latency.py --build build/release

Three processes: a coupler and a fluid without physics (link_actor), and the client as the fine side, 20 exchanges per
window. Prints rows of docs/protocol.md: microseconds per exchange, best and median of five runs.
"""
import argparse
import os
import re
import statistics
import subprocess
from pathlib import Path

HERE = Path(__file__).resolve().parent
MPIRUN = ["mpirun", "--oversubscribe", "--bind-to", "none", "--mca", "mpi_yield_when_idle", "1"]


def once(build, client, nodes, windows):
    actor = str(build / "tests" / "link_actor")
    common = [f"--nodes={nodes}", f"--windows={windows}", "--m=20", "--hello=20", "--start=20", "--stall=20"]
    line = [*MPIRUN, "-n", "1", actor, "--role=coupler", *common, ":", "-n", "1", actor, "--role=fluid", *common, ":", "-n", "1", *client]
    environment = dict(os.environ, OMPI_ALLOW_RUN_AS_ROOT="1", OMPI_ALLOW_RUN_AS_ROOT_CONFIRM="1", PYTHONPATH=str(build / "lib"))
    done = subprocess.run(line, env=environment, stdout=subprocess.PIPE, text=True, check=True)
    return float(re.search(r"([\d.]+) us per exchange", done.stdout)[1])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", required=True)
    build = Path(parser.parse_args().build).resolve()
    clients = {"C++": lambda n: [str(build / "tests" / "link_actor"), "--role=solid", f"--nodes={n}", "--hello=20", "--start=20"],
               "C": lambda n: [str(build / "tests" / "latency_client"), str(n)],
               "Python": lambda n: ["/usr/bin/python3", str(HERE / "latency_client.py"), str(n)]}
    print("| client | cores | 64 nodes (1 kB) | 640 nodes (10 kB) |")
    print("| --- | --- | --- | --- |")
    for busy in (0, os.cpu_count()):
        hogs = [subprocess.Popen(["/usr/bin/python3", "-c", "while True: pass"]) for _ in range(busy)]
        try:
            for name, client in clients.items():
                cells = []
                for nodes in (64, 640):
                    runs = [once(build, client(nodes), nodes, 20 if busy else 200) for _ in range(5)]
                    cells.append(f"{min(runs):.1f} / {statistics.median(runs):.1f}")
                print(f"| {name} | {'busy' if busy else 'idle'} | {' | '.join(cells)} |", flush=True)
        finally:
            for hog in hogs:
                hog.kill()


if __name__ == "__main__":
    main()
