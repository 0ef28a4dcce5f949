"""A sweep on a Ray cluster: python examples/sweep_ray.py FOLDER [SHARDS] [ADDRESS]

FOLDER was made by `sinew sweep plan` and can be reached by all workers. Without an address, workers
are processes here, but Ray's daemons listen on all networks, behind its token. SINEW: the command.
"""

import os
import subprocess
import sys


def shard(folder, index, count):
    """Runs one shard; Ray calls it again elsewhere when the worker dies."""
    command = [os.environ.get("SINEW", "sinew"), "sweep", "run", folder]
    # --wait: the command of a worker that died may still be at work on the shard
    command += ["--shard", f"{index}/{count}", "--wait", "--quiet"]
    code = subprocess.run(command).returncode
    if code not in (0, 3):  # 3: all done, some runs failed, which the table tells
        raise RuntimeError(f"shard {index}/{count} ended with code {code}")
    return index


def main(folder, shards=8, address=None, watch=lambda ray: None):
    import ray

    local = {} if address else dict(_node_ip_address="127.0.0.1", include_dashboard=False)
    ray.init(address=address, **local)
    task = ray.remote(max_retries=3)(shard)
    waiting = [task.remote(folder, i, shards) for i in range(shards)]
    watch(ray)
    while waiting:
        done, waiting = ray.wait(waiting)
        print(f"{shards - len(waiting)} of {shards} shards", ray.get(done))
    ray.shutdown()
    merge = [os.environ.get("SINEW", "sinew"), "sweep", "merge", folder]
    return subprocess.run(merge).returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], *map(int, sys.argv[2:3]), *sys.argv[3:4]))
