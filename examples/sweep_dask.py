"""A sweep on a Dask cluster: python examples/sweep_dask.py FOLDER [SHARDS] [SCHEDULER]

FOLDER was made by `sinew sweep plan` and can be reached by all workers. Without a scheduler's
address, workers are processes of this machine and nothing listens beyond it.
SINEW names the command where it is not on the path.
"""

import os
import subprocess
import sys


def shard(folder, index, count):
    """Runs one shard; Dask calls it again elsewhere when the worker dies."""
    command = [os.environ.get("SINEW", "sinew"), "sweep", "run", folder]
    # --wait: the command of a worker that died may still be at work on the shard
    command += ["--shard", f"{index}/{count}", "--wait", "--quiet"]
    code = subprocess.run(command).returncode
    if code not in (0, 3):  # 3: all done, some runs failed, which the table tells
        raise RuntimeError(f"shard {index}/{count} ended with code {code}")
    return index


def main(folder, shards=8, scheduler=None, watch=lambda client: None):
    from dask.distributed import Client, LocalCluster, as_completed

    cluster = scheduler or LocalCluster(threads_per_worker=1, host="127.0.0.1", dashboard_address=None)
    with Client(cluster) as client:
        futures = client.map(shard, [folder] * shards, range(shards), [shards] * shards, pure=False)
        watch(client)
        for done, future in enumerate(as_completed(futures), 1):
            future.result()
            print(f"{done} of {shards} shards")
    merge = [os.environ.get("SINEW", "sinew"), "sweep", "merge", folder]
    return subprocess.run(merge).returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], *map(int, sys.argv[2:3]), *sys.argv[3:4]))
