"""Runs a command such as an mpirun line, watches its processes, and reads what it leaves behind."""
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))
from lib.launch import ENVIRONMENT, MPIRUN, ROOT  # noqa: E402, F401


def descendants(root):
    """{process id: command name} of all living descendants of `root`; zombies do not count."""
    children, names = {}, {}
    for entry in os.listdir("/proc"):
        if entry.isdigit():
            try:
                with open(f"/proc/{entry}/stat") as stat:
                    head, _, tail = stat.read().rpartition(")")
            except OSError:
                continue
            state, parent = tail.split()[:2]
            if state not in "ZX":
                children.setdefault(int(parent), []).append(int(entry))
                names[int(entry)] = head.partition("(")[2]
    found, front = {}, [root]
    while front:
        front = [child for pid in front for child in children.get(pid, [])]
        found.update({pid: names[pid] for pid in front})
    return found


def alive(pid):
    """True if the process exists and is no zombie."""
    try:
        with open(f"/proc/{pid}/stat") as stat:
            return stat.read().rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False


class Ended:
    """How a run ended: exit code as a shell counts (None: it had to be ended), text of stdout and stderr, seconds,
    and processes that were left."""

    def __init__(self, code, text, seconds, left):
        self.code, self.text, self.seconds, self.left = code, text, seconds, left

    def errors(self):
        """What our programs had to say, without mpirun's own notices."""
        return [line for line in self.text.split("\n") if line.startswith("error: ")]


def code_of(status, text):
    """Exit code as a shell counts, None while it runs. Where `mpirun` itself crashes when all its programs are gone (docs/protocol.md,
    section 6: a fault of Open MPI 4.1.4), the code that it was told to end with."""
    told = re.search(r"^with errorcode (\d+)\.$", text, re.MULTILINE)
    if status in (-11, 139) and told and "(orte_finalize+" in text:
        return int(told[1])
    return 128 - status if status is not None and status < 0 else status


def run(line, limit, act=None):
    """Run `line` for at most `limit` seconds, then end it; `act(process)` may interfere while it runs."""
    with tempfile.TemporaryFile("w+") as log:
        begin = time.monotonic()
        process = subprocess.Popen(line, stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT, env=ENVIRONMENT,
                                   start_new_session=True, cwd=ROOT)
        pids = set()
        try:
            if act:
                act(process)
                begin = time.monotonic()  # the time that counts begins when something goes wrong
            while process.poll() is None and time.monotonic() - begin < limit:
                pids.update(descendants(process.pid))
                time.sleep(0.02)
        finally:
            seconds = time.monotonic() - begin
            code = process.poll()
            if code is None:
                pids.update(descendants(process.pid))
            else:
                time.sleep(0.2)
            left = [pid for pid in pids if alive(pid)]
            process.kill()
            process.wait()
            for pid in filter(alive, left):
                os.kill(pid, signal.SIGKILL)
        log.seek(0)
        text = log.read()
        return Ended(code_of(code, text), text, seconds, left)


def read_failed(out):
    """FAILED.toml as {key: text}, {} if there is none."""
    try:
        lines = (Path(out) / "FAILED.toml").read_text().split("\n")
    except FileNotFoundError:
        return {}
    return dict(line.split(" = ", 1) for line in lines if " = " in line)
