import signal
import time
from pathlib import Path

from nhpocp.solution_folder.pictures import attempted
from nhpocp.whole import write_file


def stopped(*_):
    signal.raise_signal(signal.SIGINT)
    time.sleep(8)


t = time.time()
print(attempted(stopped), time.time() - t)
t = time.time()
print(attempted(lambda: write_file(Path("/tmp/wRs/x.html"), stopped)), time.time() - t)
