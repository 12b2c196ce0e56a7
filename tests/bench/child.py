"""Runs one program of the benchmark: one child process, with limits, on cores of its own."""
import json
import os
import resource
import shutil
import signal
import subprocess
import tempfile

# A program that asks for one thread in every way there is.
ONE_THREAD = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS",
                                     "TBB_NUM_THREADS", "IGL_NUM_THREADS")}

# What a program has freed it keeps: else the figures of repeated work hang on where the C library's thresholds for
# giving memory back happen to fall, which moves a build by a factor of two.
KEPT_MEMORY = {"MALLOC_TRIM_THRESHOLD_": str(1 << 30), "MALLOC_MMAP_THRESHOLD_": str(1 << 30)}


def pin(threads):
    """Words that put a command on the last cores of this machine: the first one gets most interrupts."""
    cores = sorted(os.sched_getaffinity(0))[-threads:]
    if len(cores) < threads or not shutil.which("taskset"):
        return []
    return ["taskset", "-c", ",".join(str(core) for core in cores)]


def describe_end(status, limit_s):
    if os.WIFSIGNALED(status):
        number = os.WTERMSIG(status)
        if number == signal.SIGALRM:
            return f"did not end in {limit_s:g} s"
        return f"ended by {signal.Signals(number).name}"
    return f"exit status {os.WEXITSTATUS(status)}"


def run(command, threads=1, limit_s=120.0, limit_bytes=6 << 30):
    """The JSON object that the command prints, or {"failed": why}.

    The memory limit is on the address space, so that a program that eats memory is refused more of it.
    """
    def prepare():
        resource.setrlimit(resource.RLIMIT_AS, (limit_bytes, limit_bytes))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        # Alarms outlive exec, and no handler does: the program ends with the signal.
        signal.setitimer(signal.ITIMER_REAL, limit_s)

    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        child = subprocess.Popen(pin(threads) + [str(word) for word in command], stdout=out, stderr=err,
                                 stdin=subprocess.DEVNULL, env=os.environ | ONE_THREAD | KEPT_MEMORY, preexec_fn=prepare)
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = status
        out.seek(0)
        err.seek(0)
        printed, complaint = out.read().decode(), err.read().decode(errors="replace").strip()
    lines = [line for line in printed.splitlines() if line.startswith("{")]
    why = describe_end(status, limit_s) if status else "printed no result"
    if status == 0 and lines:
        try:
            return json.loads(lines[-1])
        except json.JSONDecodeError:
            complaint = lines[-1]
    if "alloc" in complaint.lower() or "memory" in complaint.lower():
        why = f"allocated more than {limit_bytes / 2**30:g} GiB"
    return {"failed": why, "complaint": complaint[-400:], "peak_kb": usage.ru_maxrss}
