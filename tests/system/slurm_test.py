#!/usr/bin/python3
"""The job scripts of scripts/slurm in a real Slurm of one node, started by the test in a folder of its own.

Example: tests/system/slurm_test.py --build build/release        (as root; Debian: slurm-wlm)

Truth: the coupled column through the queue writes the same histories as on a bare mpirun line, to the byte; also when Slurm's
warning before the time limit stops the job, puts it back into the queue, and it goes on from its checkpoint. A run that fails
ends its job with the documented code.
"""
import os
import pwd
import shutil
import socket
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
import programs  # noqa: E402

NEEDED = ["munged", "slurmctld", "slurmd", "sbatch", "srun", "scontrol", "squeue", "scancel"]
JOBS = programs.ROOT / "scripts" / "slurm"

CONFIGURATION = """\
ClusterName=undine
SlurmctldHost={host}(127.0.0.1)
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
CredType=cred/munge
SlurmctldPort={port}
SlurmdPort={port1}
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
MpiDefault=none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SlurmdParameters=config_overrides
SchedulerParameters=sched_interval=1,requeue_delay=0
ReturnToService=2
KillWait=5
MinJobAge=600
NodeName={host} NodeAddr=127.0.0.1 CPUs=8 RealMemory=1000 State=UNKNOWN
PartitionName=all Nodes={host} Default=YES MaxTime=INFINITE State=UP OverSubscribe=FORCE
"""


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


class Cluster:
    """munged, slurmctld and slurmd of one node, with everything they write in `folder`."""

    def __init__(self, folder):
        self.folder, self.daemons = folder, []
        for name in ("state", "spool"):
            (folder / name).mkdir()
        key = folder / "munge.key"
        key.write_bytes(os.urandom(128))
        key.chmod(0o400)
        host = socket.gethostname().split(".")[0]
        self.configuration = folder / "slurm.conf"
        self.configuration.write_text(CONFIGURATION.format(host=host, folder=folder, port=free_port(), port1=free_port()))
        (folder / "cgroup.conf").write_text("CgroupAutomount=no\n")
        self.environment = dict(programs.ENVIRONMENT, SLURM_CONF=str(self.configuration))
        # munged refuses folders that others may write to
        self.start(["munged", "--foreground", "--force", f"--socket={folder}/munge.socket", f"--key-file={key}", f"--log-file={folder}/munged.log",
                    f"--pid-file={folder}/munged.pid", f"--seed-file={folder}/munged.seed"])
        self.wait(lambda: (folder / "munge.socket").exists(), 10, "munged")
        self.start(["slurmctld", "-D", "-f", str(self.configuration)])
        self.start(["slurmd", "-D", "-f", str(self.configuration), "-N", host])
        self.wait(lambda: "idle" in self.ask("sinfo", "-h", "-o", "%T"), 60, "the node")

    def start(self, command):
        program = shutil.which(command[0], path=os.environ["PATH"] + ":/usr/sbin")
        with open(self.folder / f"{command[0]}.out", "w") as log:
            self.daemons.append(subprocess.Popen([program, *command[1:]], env=self.environment, stdout=log, stderr=subprocess.STDOUT,
                                                 start_new_session=True))

    def ask(self, *command):
        done = subprocess.run(command, env=self.environment, capture_output=True, text=True, timeout=60)
        return done.stdout + done.stderr

    @staticmethod
    def wait(condition, limit, what):
        begin = time.monotonic()
        while not condition():
            if time.monotonic() - begin > limit:
                raise AssertionError(f"Slurm: {what} is not there after {limit} s")
            time.sleep(0.3)

    def stop(self):
        self.ask("scancel", "--user", pwd.getpwuid(os.getuid()).pw_name)
        for daemon in reversed(self.daemons):
            daemon.terminate()
        for daemon in self.daemons:
            try:
                daemon.wait(10)
            except subprocess.TimeoutExpired:
                daemon.kill()

    def submit(self, script, *words, options=(), log):
        """@returns the number of the job"""
        text = self.ask("sbatch", "--parsable", "-n", "3", f"--output={log}", f"--chdir={programs.ROOT}", *options, str(script), *words)
        number = text.strip().split("\n")[-1]
        assert number.isdigit(), text
        return number

    def fields(self, job):
        """What Slurm knows of a job: {"JobState": "RUNNING", "Restarts": "0", ...}"""
        return dict(word.split("=", 1) for word in self.ask("scontrol", "show", "job", job).split() if "=" in word)

    def state(self, job):
        """State and exit code of a job, such as ("COMPLETED", 0)."""
        fields = self.fields(job)
        return fields.get("JobState", "UNKNOWN"), int(fields.get("ExitCode", "0:0").split(":")[0])

    def end_of(self, job, limit):
        self.wait(lambda: self.state(job)[0] not in ("PENDING", "CONFIGURING", "RUNNING", "COMPLETING", "REQUEUED", "UNKNOWN"), limit, f"the end of job {job}")
        return self.state(job)


class Slurm(programs.SystemTest):
    @classmethod
    def setUpClass(cls):
        cls.place = tempfile.TemporaryDirectory(prefix="undine-slurm-")
        Path(cls.place.name).chmod(0o755)
        cls.cluster = Cluster(Path(cls.place.name))
        cls.cluster.environment.update(UNDINE=str(programs.BUILD / "bin"), MPIRUN_OPTIONS=" ".join(programs.MPIRUN[1:]))
        # Long enough to be stopped in the middle.
        cls.words = ["--set", "run.resolution=40", "--until", "0.5"]
        cls.straight = Path(cls.place.name) / "straight"
        ended = programs.run(programs.coupled_line(programs.COLUMN, cls.straight, *cls.words), 200)
        assert ended.code == 0, ended.text

    @classmethod
    def tearDownClass(cls):
        cls.cluster.stop()
        cls.place.cleanup()

    def same_histories(self, out):
        for path in sorted(self.straight.glob("history/*.csv")):
            self.assertEqual((out / "history" / path.name).read_bytes(), path.read_bytes(), path.name)

    def through_the_queue(self, script):
        out, log = self.out / "run", self.folder / "job.log"
        job = self.cluster.submit(JOBS / script, str(programs.COLUMN), "--out", str(out), *self.words, log=log)
        state = self.cluster.end_of(job, 200)
        self.assertEqual(state, ("COMPLETED", 0), log.read_text() if log.exists() else "no log")
        self.same_histories(out)

    def test_mpirun(self):
        self.through_the_queue("mpirun.sbatch")

    def test_srun(self):
        self.through_the_queue("srun.sbatch")

    def stopped_and_continued(self, script, *options):
        out, log = self.out / "run", self.folder / "job.log"
        job = self.cluster.submit(JOBS / script, str(programs.COLUMN), "--out", str(out), *self.words, options=options, log=log)
        self.cluster.wait(lambda: any(out.glob("history/*.csv")), 60, "the first history")
        time.sleep(1)
        # What Slurm does USR1_SECONDS before the limit.
        self.cluster.ask("scancel", "--signal=USR1", *(["--batch"] if script == "mpirun.sbatch" else []), job)
        self.cluster.wait(lambda: self.cluster.fields(job).get("Restarts") == "1", 60, "the second start")
        time.sleep(3)  # the node must have forgotten the first start
        self.cluster.ask("scontrol", "update", f"JobId={job}", "StartTime=now")  # Slurm would wait two minutes
        state = self.cluster.end_of(job, 300)
        text = log.read_text()
        self.assertEqual(state, ("COMPLETED", 0), text)
        self.assertIn("back into the queue", text)
        self.same_histories(out)

    def test_mpirun_stopped_and_continued(self):
        self.stopped_and_continued("mpirun.sbatch")

    def test_srun_stopped_and_continued(self):
        self.stopped_and_continued("srun.sbatch")

    def test_a_failure_ends_the_job_with_its_code(self):
        """A mistake in the case: code 2 from both kinds of job."""
        for script in ("mpirun.sbatch", "srun.sbatch"):
            log = self.folder / f"{script}.log"
            job = self.cluster.submit(JOBS / script, str(programs.COLUMN), "--out", str(self.out / script), "--set", "run.resolutoin=20", log=log)
            state, code = self.cluster.end_of(job, 60)
            self.assertEqual((state, code), ("FAILED", 2), log.read_text())
            self.assertIn("resolutoin", log.read_text())


if __name__ == "__main__":
    missing = [name for name in NEEDED if shutil.which(name, path=os.environ["PATH"] + ":/usr/sbin") is None]
    if missing or os.getuid() != 0:
        print("skipped: " + (f"not installed: {' '.join(missing)} (Debian: slurm-wlm)" if missing else "starts system programs: root only"))
        sys.exit(77)
    programs.main(__doc__)
