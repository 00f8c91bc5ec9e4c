"""A bot of the JSON-lines protocol, in plain Python; its first argument is its fault."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

habit = sys.argv[1]


def write(text):
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def send(answer):
    write(json.dumps(answer))


def start_processes():
    """Start a process, and write its number and this one's to the file of the second argument."""
    if habit == "hangs":
        child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
        number = str(child.pid)
    else:  # a child in a session of its own, whose parent ends
        read, written = os.pipe()
        if os.fork() == 0:
            os.setsid()
            if os.fork() == 0:
                os.write(written, str(os.getpid()).encode())
                while habit == "hops":
                    if os.fork():
                        os._exit(0)
                    os.setsid()
                time.sleep(600)
            os._exit(0)
        number = os.read(read, 9).decode()
    Path(sys.argv[2]).write_text(f"{os.getpid()} {number}", "utf-8")


hello = json.loads(sys.stdin.readline())
FINISH = hello["actions"].index("finish")
if habit in ("hangs", "escapes", "stops its supervisor", "kills its supervisor", "hops"):
    start_processes()  # before it is ready: the time limit of an answer does not depend on it
if habit == "never ready":
    send({"type": "hello"})
elif habit == "dies at once":
    sys.exit(7)
elif habit == "wants gzip":
    send({"type": "ready", "arrays": "gzip"})
else:
    send({"type": "ready", "name": f"bot {habit}", "representation": "vector"})
if habit == "talks":
    send({"actions": [0]})
for line in sys.stdin:
    asked = json.loads(line)
    number = len(asked["masks"])
    finish = [FINISH] * number
    if habit == "stops its supervisor":
        os.kill(os.getppid(), signal.SIGSTOP)
    elif habit == "kills its supervisor":
        os.kill(os.getppid(), signal.SIGKILL)
    elif habit == "forks":
        children = [subprocess.Popen(["sleep", "600"]) for _ in range(6)]
    elif habit == "allocates":
        bytearray(3 << 30)
    elif habit == "dies":
        sys.exit(3)
    if habit in ("hangs", "escapes", "hops", "forks") or habit.endswith(" its supervisor"):
        time.sleep(600)
    elif habit in ("prints", "nests"):
        write("my move is 1" if habit == "prints" else "[" * 100_000)
    else:
        answers = {
            "paints": {"error": "\x1b[31mred\nline \u202egnp.exe\u200b \ud800"},
            "lists": finish,
            "forgets": {"moves": finish},
            "gives up": {"error": "out of ideas"},
            "cheats": {"actions": [99] * number},
            "halves": {"actions": [0.5] * number},
            "draws": {"actions": [asked["seed"] % 2] * number},
        }
        send(answers.get(habit, {"actions": finish}))
