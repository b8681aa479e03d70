"""Print a file with Printrun's printcore and print the result as JSON; arguments: PORT FILE SECONDS.

The Python of Printrun's environment runs this file.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from threading import Event
from time import monotonic

from printrun.gcoder import LightGCode
from printrun.printcore import printcore

port, path, patience = sys.argv[1], sys.argv[2], float(sys.argv[3])
ended = Event()
begun = monotonic()
core = printcore()
core.endcb = ended.set
core.errorcb = lambda text: print(text, file=sys.stderr)
online = Event()
core.onlinecb = online.set
core.connect(port, 115200)
if not online.wait(20):
    sys.exit("not online")
core.startprint(LightGCode(Path(path).read_text(encoding="latin-1").splitlines()))
# printcore sets `printing` in the calling thread; another thread reports the end.
done = ended.wait(patience)
while done and not core.priqueue.empty() and monotonic() - begun < patience:
    Event().wait(0.05)
Event().wait(1.0)
print(json.dumps({"done": done, "printing": core.printing, "seconds": monotonic() - begun}), flush=True)
core.disconnect()
