"""Runs a command and prints its wall time [s], peak memory [MB] and exit status as JSON.

A process of its own, and a slim one: on Linux a child's peak begins with the memory of the process that started it.
Usage: python -I -S cold.py COMMAND…
"""

import json
import os
import subprocess
import sys
from time import perf_counter

began = perf_counter()
with subprocess.Popen(sys.argv[1:], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL) as child:
    _, status, usage = os.wait4(child.pid, 0)
    seconds = perf_counter() - began
    child.returncode = os.waitstatus_to_exitcode(status)
unit = 2**20 if sys.platform == "darwin" else 2**10  # of ru_maxrss
print(json.dumps({"seconds": seconds, "megabytes": usage.ru_maxrss / unit, "status": child.returncode}))
