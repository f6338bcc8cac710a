"""How large a report.html is, how long Chromium takes to open it, and how fast its slider is: page.py CHROMIUM FILE ROUNDS."""

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time


class Browser:
    """Headless Chromium, driven over its DevTools protocol through two pipes."""

    def __init__(self, program):
        self.profile = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        command = 'exec "$0" "$@" 3<&0 4>&1 </dev/null >/dev/null 2>&1'
        options = ["--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run",
                   "--remote-debugging-pipe", "--window-size=1300,1000", f"--user-data-dir={self.profile.name}", "about:blank"]
        self.process = subprocess.Popen(["sh", "-c", command, program, *options], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self.number, self.session, self.buffer, self.events = 0, None, b"", []
        target = self.call("Target.createTarget", url="about:blank")
        self.session = self.call("Target.attachToTarget", targetId=target["targetId"], flatten=True)["sessionId"]
        for domain in ["Page", "Runtime"]:
            self.call(f"{domain}.enable")

    def read(self):
        while b"\0" not in self.buffer:
            more = os.read(self.process.stdout.fileno(), 1 << 20)
            if not more:
                sys.exit("the browser ended")
            self.buffer += more
        message, self.buffer = self.buffer.split(b"\0", 1)
        return json.loads(message)

    def call(self, method, **params):
        self.number += 1
        message = {"id": self.number, "method": method, "params": params}
        if self.session:
            message["sessionId"] = self.session
        self.process.stdin.write(json.dumps(message).encode() + b"\0")
        self.process.stdin.flush()
        while True:
            answer = self.read()
            if answer.get("id") == self.number:
                if "error" in answer:
                    sys.exit(f"{method}: {answer['error']}")
                return answer["result"]
            self.events.append(answer)

    def open(self, file):
        """Opens a file; gives the seconds until all of it was there, and until its first frame was drawn."""
        self.events.clear()
        begun = time.monotonic()
        self.call("Page.navigate", url="file://" + os.path.abspath(file))
        while not any(event["method"] == "Page.loadEventFired" for event in self.events):
            self.events.append(self.read())
        loaded = time.monotonic() - begun
        while not self.eval("window.depthloomPage && document.querySelector('.view canvas').width > 8"):
            time.sleep(0.005)
        return loaded, time.monotonic() - begun

    def eval(self, expression):
        answer = self.call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in answer:
            sys.exit(json.dumps(answer["exceptionDetails"]))
        return answer["result"].get("value")

    def close(self):
        self.process.kill()
        self.process.wait()


# The slider moves by one frame whenever the browser requests the next picture, as with a hand; the drawn pictures are counted.
DRAG = """(async () => {
  const slider = document.getElementById("slider"), { state } = depthloomPage, last = Number(slider.max);
  slider.scrollIntoView({ behavior: "instant" });
  const before = state.drawn, begun = performance.now();
  for (let place = 0; place <= last; place++) {
    slider.value = place;
    slider.dispatchEvent(new Event("input"));
    do await new Promise(requestAnimationFrame); while (state.busy && state.wanted !== state.place);
  }
  while (state.busy) await new Promise(requestAnimationFrame);
  return 1000 * (state.drawn - before) / (performance.now() - begun);
})()"""

program, file, rounds = sys.argv[1], sys.argv[2], int(sys.argv[3])
loaded, drawn, cold, warm = [], [], [], []
for _ in range(rounds):
    browser = Browser(program)
    seconds = browser.open(file)
    loaded.append(seconds[0])
    drawn.append(seconds[1])
    cold.append(browser.eval(DRAG))
    warm.append(browser.eval(DRAG))
    counts = browser.eval("[depthloomPage.state.part.frames.length, depthloomPage.state.views.length, document.querySelector('.view:nth-child(2) canvas').width]")
    browser.close()
print(f"page size-mb {os.path.getsize(file) / 1e6:.1f}")
print(f"page frames {counts[0]}")
print(f"page views {counts[1]}")
print(f"page map-columns {counts[2]}")
print(f"page open-s {statistics.median(loaded):.2f}")
print(f"page first-frame-s {statistics.median(drawn):.2f}")
print(f"page slider-first-fps {statistics.median(cold):.1f}")
print(f"page slider-again-fps {statistics.median(warm):.1f}")
