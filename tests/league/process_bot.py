"""A bot of the JSON-lines protocol, in plain Python; its word says what it does wrong."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

habit = sys.argv[1] if len(sys.argv) > 1 else "good"


def write(text):
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def say(answer):
    write(json.dumps(answer))


hello = json.loads(sys.stdin.readline())
FINISH = hello["actions"].index("finish")
if habit == "never ready":
    say({"type": "hello"})
elif habit == "dies at once":
    sys.exit(7)
elif habit == "wants gzip":
    say({"type": "ready", "arrays": "gzip"})
else:
    say({"type": "ready", "name": f"bot {habit}", "representation": "vector"})
if habit == "talks":
    say({"actions": [0]})
for line in sys.stdin:
    asked = json.loads(line)
    number = len(asked["masks"])
    if habit == "hangs":
        child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
        Path(sys.argv[2]).write_text(f"{os.getpid()} {child.pid}", "utf-8")
        time.sleep(600)
    elif habit in ("escapes", "stops its supervisor", "kills its supervisor", "hops"):
        read, told = os.pipe()
        if os.fork() == 0:  # a child in a session of its own, whose parent ends
            os.setsid()
            if os.fork() == 0:
                os.write(told, str(os.getpid()).encode())
                if habit == "hops":
                    while True:
                        if os.fork():
                            os._exit(0)
                        os.setsid()
                time.sleep(600)
            os._exit(0)
        Path(sys.argv[2]).write_text(f"{os.getpid()} {os.read(read, 9).decode()}", "utf-8")
        if habit == "stops its supervisor":
            os.kill(os.getppid(), signal.SIGSTOP)
        if habit == "kills its supervisor":
            os.kill(os.getppid(), signal.SIGKILL)
        time.sleep(600)
    elif habit == "allocates":
        bytearray(3 << 30)
        say({"actions": [FINISH] * number})
    elif habit == "forks":
        children = [subprocess.Popen(["sleep", "600"]) for _ in range(6)]
        time.sleep(600)
    elif habit == "paints":
        say({"error": "\x1b[31mred\nline \u202egnp.exe\u200b \ud800"})
    elif habit == "prints":
        write("my move is 1")
    elif habit == "lists":
        say([FINISH] * number)
    elif habit == "forgets":
        say({"moves": [FINISH] * number})
    elif habit == "gives up":
        say({"error": "out of ideas"})
    elif habit == "dies":
        sys.exit(3)
    elif habit == "cheats":
        say({"actions": [99] * number})
    elif habit == "halves":
        say({"actions": [0.5] * number})
    elif habit == "draws":
        say({"actions": [asked["seed"] % 2] * number})
    else:
        say({"actions": [FINISH] * number})
