#!/usr/bin/python3
"""Latency of an exchange (free velocity out, link force in) for clients in C++, C and Python, idle and on busy cores.

Examples: latency.py --build build/release
          latency.py --build build/release --clients C++ --cores idle --nodes 100 1000 10000 100000 --ranks 1 2 3 --coupler-ranks 1 2
                                                                                            (docs/benchmarks/scaling.md)

Three processes: a coupler and a fluid without physics (link_actor), and the client as the fine side, 20 exchanges per
window. --ranks: of the solid (C++), each with the rows of its own nodes. Prints rows of docs/protocol.md: microseconds per exchange, best and median of five runs; the clients take turns.
Before them, how much of the cores others used: "idle" is only true if that is little.
"""
import argparse
import os
import re
import statistics
import subprocess
import sys
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "support"))
from processes import ENVIRONMENT, MPIRUN  # noqa: E402


def once(build, client, nodes, windows, ranks=1, coupler_ranks=1):
    actor = str(build / "tests" / "link_actor")
    common = [f"--nodes={nodes}", f"--windows={windows}", "--m=20", "--hello=20", "--start=20", "--stall=20"]
    line = [*MPIRUN, "-n", str(coupler_ranks), actor, "--role=coupler", *common, ":", "-n", "1", actor, "--role=fluid", *common, ":",
            "-n", str(ranks), *client, *(["--split=yes"] if ranks > 1 else [])]
    environment = dict(ENVIRONMENT, PYTHONPATH=str(build / "lib"))
    done = subprocess.run(line, env=environment, stdout=subprocess.PIPE, text=True, check=True)
    return float(re.search(r"([\d.]+) us per exchange", done.stdout)[1])


def used_by_others(seconds=1.0):
    """Part of the cores' time that is not idle."""
    def ticks():
        values = [int(word) for word in Path("/proc/stat").read_text().split("\n", 1)[0].split()[1:9]]
        return sum(values), values[3] + values[4]
    all_before, idle_before = ticks()
    time.sleep(seconds)
    all_after, idle_after = ticks()
    return 1.0 - (idle_after - idle_before) / (all_after - all_before)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", required=True)
    parser.add_argument("--cores", choices=["idle", "busy"], nargs="+", default=["idle", "busy"])
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--clients", choices=["C++", "C", "Python"], nargs="+", default=["C++", "C", "Python"])
    parser.add_argument("--nodes", type=int, nargs="+", default=[64, 640], help="of the interface, in the plane")
    parser.add_argument("--ranks", type=int, nargs="+", default=[1], help="of the solid; more than 1 with C++ only")
    parser.add_argument("--coupler-ranks", type=int, nargs="+", default=[1])
    options = parser.parse_args()
    shapes = [(ranks, couplers) for couplers in options.coupler_ranks for ranks in options.ranks]
    build = Path(options.build).resolve()
    clients = {"C++": lambda n: [str(build / "tests" / "link_actor"), "--role=solid", f"--nodes={n}", "--hello=20", "--start=20"],
               "C": lambda n: [str(build / "tests" / "latency_client"), str(n)],
               "Python": lambda n: ["/usr/bin/python3", str(HERE / "latency_client.py"), str(n)]}
    for cores in options.cores:
        others = []
        seen = {}
        hogs = []
        for _ in range(options.runs):
            others.append(used_by_others())
            if cores == "busy":
                hogs = [subprocess.Popen(["/usr/bin/python3", "-c", "while True: pass"]) for _ in range(os.cpu_count())]
            try:
                for name in options.clients:
                    for nodes in options.nodes:
                        for ranks, couplers in shapes:
                            seen.setdefault((name, ranks, couplers, nodes), []).append(
                                once(build, clients[name](nodes), nodes, 20 if cores == "busy" or nodes > 20000 else 200, ranks, couplers))
            finally:
                for hog in hogs:
                    hog.kill()
                    hog.wait()
        print(f"{cores}: before each run others used {' '.join(f'{100 * part:.0f}' for part in others)} % of the cores")
        print("| client | ranks | of the coupler | cores | " + " | ".join(f"{n} nodes ({n // 64} kB)" for n in options.nodes) + " |\n| --- | --- | --- | --- |" + " --- |" * len(options.nodes))
        for name, (ranks, couplers) in ((name, shape) for name in options.clients for shape in shapes):
            cells = [f"{min(runs):.1f} / {statistics.median(runs):.1f}" for runs in (seen[name, ranks, couplers, nodes] for nodes in options.nodes)]
            print(f"| {name} | {ranks} | {couplers} | {cores} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
