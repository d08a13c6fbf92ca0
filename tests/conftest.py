"""One thread a process, as the tests themselves run side by side: threads that wait for each other stall otherwise."""

import os

os.environ["OMP_NUM_THREADS"] = "1"  # read when torch is first imported, here and in the programs that tests start
