"""A bot of the JSON-lines protocol, in plain Python; its word says what it does wrong."""

import json
import os
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
