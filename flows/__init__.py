"""Order: which stage follows which, on what. No arithmetic, no arrays."""

import ctypes
import logging
import os
import sys

# read by Prefect when it is first imported; what the user has set stays
os.environ.setdefault("PREFECT_SERVER_EPHEMERAL_STARTUP_TIMEOUT_SECONDS", "180")  # 20 s are usual
os.environ.setdefault("PREFECT_SERVER_ANALYTICS_ENABLED", "false")
os.environ.setdefault("DO_NOT_TRACK", "1")  # of Prefect's clients: an archive tells nobody
# what our modules say is in the log of the run too, not only Prefect's own lines
os.environ.setdefault("PREFECT_LOGGING_EXTRA_LOGGERS", "flows,tasks")
os.environ.setdefault("PREFECT_LOGGING_TO_API_WHEN_MISSING_FLOW", "ignore")
for _name in ("flows", "tasks"):
    if logging.getLogger(_name).level == logging.NOTSET:  # else only warnings would get there
        logging.getLogger(_name).setLevel(logging.INFO)

# read by numpy's linear algebra when it is first imported: frames run side by side, not products of
# small matrices, for which its threads wait longer than they work
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

if sys.platform == "linux":
    # glibc raises the size from which freed memory goes back to the system whenever a larger array
    # is freed, so that films of blocks long done stay; -3: M_MMAP_THRESHOLD, held at 8 MiB, for
    # what is larger is of several frames, and a picture of 1920 x 1080 has 6 MB
    _set_memory = getattr(ctypes.CDLL(None), "mallopt", lambda *_: 0)
    _set_memory(-3, 1 << 23)
    # the arrays of one frame, freed and made again a frame later, are kept: every page that comes
    # back costs 2 us, a tenth of the processor time of digitizing; -1: M_TRIM_THRESHOLD
    _set_memory(-1, 1 << 25)
    # what one thread has freed is the next one's: of threads that come and go, each would leave a
    # heap of its own; -8: M_ARENA_MAX
    _set_memory(-8, 1)
