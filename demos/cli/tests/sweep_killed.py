"""Runs an example of examples/ and kills the worker of its first shard: sweep_killed.py NAME FOLDER SHARDS"""

import glob
import importlib
import os
import pathlib
import signal
import sys
import threading
import time

EXAMPLES = str(pathlib.Path(__file__).resolve().parents[3] / "examples")
sys.path.insert(0, EXAMPLES)
os.environ["PYTHONPATH"] = EXAMPLES  # for workers


def parent(pid):
    """The parent of a process."""
    with open(f"/proc/{pid}/stat") as stat:
        return int(stat.read().rsplit(")", 1)[1].split()[1])


def kill(folder):
    """Once results come in, kills the worker behind a command that is at work, and the command."""
    while True:
        for path in glob.glob(f"{folder}/shards/*.jsonl"):
            shard = os.path.basename(path)[: -len(".jsonl")]
            with open(f"{folder}/claims/{shard}") as claim:
                text = claim.read()
            if os.path.getsize(path) < 2000 or '"released":true' in text:
                continue
            pid = int(text.split('"pid":')[1].split(",")[0])
            try:
                worker = parent(pid)
                os.kill(worker, signal.SIGKILL)
                os.kill(pid, signal.SIGKILL)
            except (FileNotFoundError, ProcessLookupError):
                continue
            print("killed a worker", flush=True)
            return
        time.sleep(0.005)


def main(name, folder, shards):
    watch = lambda engine: threading.Thread(target=kill, args=[folder], daemon=True).start()
    return importlib.import_module(name).main(folder, int(shards), watch=watch)


if __name__ == "__main__":
    code = main(*sys.argv[1:4])
    sys.exit(0 if code in (0, 3) else code)
