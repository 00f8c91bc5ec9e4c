"""A bot of the JSON-lines protocol that needs 3 GiB, and reports a MemoryError."""

import json
import sys

sys.stdin.readline()
print(json.dumps({"type": "ready"}), flush=True)  # noqa: T201  # the protocol
for line in sys.stdin:
    asked = json.loads(line)
    try:
        bytearray(3 << 30)
        print(json.dumps({"actions": [0] * asked["num"]}), flush=True)  # noqa: T201
    except MemoryError:
        print(json.dumps({"error": "MemoryError"}), flush=True)  # noqa: T201
