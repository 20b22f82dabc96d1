"""A report page of a million epochs in Chromium: its size, whether it keeps the extremes, and how long a zoom takes.

A log of so many epochs is filtered for its page (`relnav report LOG --model three_beacon_psd`) and into a track. The
page is opened in Chromium without a screen, 1200 x 900. A zoom is timed from the call to the end of the frame that
shows it, with each section of the page in sight; a turn of the approach in space likewise.
Beside it the processor time of the page's own thread. Needs chromium and playwright.

    python benchmarks/page_fluidity.py
    python benchmarks/page_fluidity.py --epochs 1000 --processor-slower 4
"""

import argparse
import base64
import json
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
from long_logs import write_long_log

MODEL = "three_beacon_psd"
FLOWN = Path(__file__).parents[1] / "examples" / "basilisk_approach" / "vbar_log.csv"
ZOOM = """async ([low, high]) => {
  const begin = performance.now();
  relnavPage.show(low, high);
  await new Promise(done => requestAnimationFrame(() => setTimeout(done, 0)));
  return performance.now() - begin;
}"""
TURN = """async () => {
  const begin = performance.now();
  document.getElementById("space").dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowLeft", bubbles: true }));
  await new Promise(done => requestAnimationFrame(() => setTimeout(done, 0)));
  return performance.now() - begin;
}"""


def made(folder: Path, epochs: int) -> tuple[Path, Path]:
    """Page and track of a log of so many epochs."""
    from relnav.files.logs import read_log

    log, page, track = folder / "log.parquet", folder / "run.html", folder / "track.parquet"
    write_long_log(read_log(FLOWN), epochs, log)
    for name, out in (("report", page), ("filter", track)):
        command = [name, log, "--model", MODEL, "--out", out]
        began = time.perf_counter()
        subprocess.run([sys.executable, "-m", "relnav", *map(str, command), "--quiet"], check=True)
        print(f"relnav {name} of {epochs} epochs: {time.perf_counter() - began:.1f} s")
    return page, track


def extremes(page: Path, track: Path) -> None:
    """Compare least and greatest value of every column that page and track have."""
    text = page.read_text(encoding="utf-8")
    columns = json.loads(re.search(r'id="data">(.*?)</script>', text, re.S).group(1))["columns"]
    file = pq.ParquetFile(track)
    shared = [name for name in columns if name in file.schema_arrow.names]
    table = file.read(columns=shared)
    points = 0
    for name in shared:
        drawn = np.frombuffer(base64.b64decode(columns[name]), "<f4")
        whole = table.column(name).to_numpy().astype("<f4")
        points = len(drawn)
        assert (np.nanmin(drawn), np.nanmax(drawn)) == (np.nanmin(whole), np.nanmax(whole)), name
    print(f"page: {len(text) / 1e6:.1f} MB, {points} points a curve; extremes of {len(shared)} columns are the track's")


def timed(page: Path, slower: float) -> None:
    """Zoom and turn in Chromium."""
    from playwright.sync_api import sync_playwright

    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=chromium, args=["--no-sandbox", "--disable-gpu"])
        shown = browser.new_page(viewport={"width": 1200, "height": 900})
        tools = shown.context.new_cdp_session(shown)
        tools.send("Performance.enable", {"timeDomain": "threadTicks"})
        if slower > 1.0:
            tools.send("Emulation.setCPUThrottlingRate", {"rate": slower})
        began = time.perf_counter()
        shown.goto(page.as_uri())
        while not shown.evaluate("'relnavPage' in window"):  # its policy allows no function that waits in the page
            time.sleep(0.01)
        print(f"Chromium {browser.version}: opened in {time.perf_counter() - began:.2f} s")
        begin, end = shown.evaluate("relnavPage.shown()")
        rng = np.random.default_rng(1)
        for section in ("docking", "states", "measurements", "timeline"):
            shown.evaluate(f"document.getElementById('{section}').scrollIntoView()")
            shown.wait_for_timeout(800)
            times, before = [], processor_ms(tools)
            for share in (0.5, 0.1, 0.01, 0.5, 0.1, 0.01, 1.0) * 4:
                low = begin + rng.uniform(0.0, 1.0 - share) * (end - begin)
                times.append(shown.evaluate(ZOOM, [low, low + share * (end - begin)]))
            report(f"zoom, {section} in sight", times, processor_ms(tools) - before)
        shown.evaluate("document.getElementById('space').scrollIntoView()")
        before = processor_ms(tools)
        times = [shown.evaluate(TURN) for _ in range(30)]
        report("turn of the approach in space", times, processor_ms(tools) - before)
        browser.close()


def processor_ms(tools) -> float:
    """Of the page's thread so far."""
    metrics = tools.send("Performance.getMetrics")["metrics"]
    return 1e3 * next(metric["value"] for metric in metrics if metric["name"] == "TaskDuration")


def report(what: str, times: list[float], processor: float) -> None:
    """One line of times, ms."""
    each = f"{processor / len(times):.0f} ms of processor time each"
    print(f"{what}: median {statistics.median(times):.0f} ms, longest {max(times):.0f} ms of {len(times)}; {each}")


def main() -> None:
    """Run the comparison."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--epochs", type=int, default=1_000_000)
    parser.add_argument("--page", type=Path, help="A page that is there already, instead.")
    parser.add_argument("--processor-slower", type=float, default=1.0, help="Chromium's emulation of a slower one.")
    asked = parser.parse_args()
    if asked.page is not None:
        timed(asked.page.resolve(), asked.processor_slower)
        return
    with tempfile.TemporaryDirectory() as folder:
        page, track = made(Path(folder), asked.epochs)
        extremes(page, track)
        timed(page, asked.processor_slower)


if __name__ == "__main__":
    main()
