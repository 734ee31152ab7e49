"""A script for `ScriptProcess`: answers, fails, dies, leaves a child or hangs, as it is told."""

import os
import subprocess
import sys
import time

import numpy as np


def make_handler(setup):
    if setup["mode"] == "broken":
        raise KeyError("in the beginning")
    print("this line does not disturb the answers")

    def handle(request):
        mode = bytes(request["mode"]).decode()
        if mode == "die":
            os._exit(7)
        if mode == "fail":
            raise ZeroDivisionError("by mistake")
        if mode == "hang":
            time.sleep(60)
        if mode == "hang with a child":
            subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"]).wait()
        return {**request, "pid": np.array(os.getpid()), "path": np.array(len(sys.path))}

    return handle
