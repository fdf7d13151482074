"""``make golden``: results of this checkout on sample recordings, against those of a commit.

`python scripts/golden.py [COMMIT]` writes the results of this checkout to the folder of caches, and a digest of them by
the tool beside the samples. With a COMMIT, its results are made in a work tree of its own (once) and compared: exit
status 0 if all figures agree to 1e-9, 1 with a list of the differences, worst first.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

from installing import CHECKOUT

SAMPLES = CHECKOUT.parent / "shared" / "data"
TOOL = CHECKOUT.parent / "shared" / "tools" / "golden.py"
CACHE = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "furrowmap" / "golden"
INPUTS = CACHE / "inputs"
TWO_SCANNERS = """name = "two_scanners"
title = "Two scanners"
seed = 4
walls = [[10.0, 18.5, 5.0, 12.0, 1.0, 3.5, 5.0], [18.5, 12.0, 95.0, 6.0, 0.2, 2.0, 4.0]]

[field]
size_e_m = 20.0
size_n_m = 20.0

[drive]
passes = 2
pass_m = [5.0]
stand_start_s = 0.4

[lidar]
max_range_m = 20.0

[second_lidar]
xyz_m = [1.9, -0.05, 2.25]
rpy_deg = [0.0, 35.0, 0.0]
true_xyz_m = [1.9, -0.05, 2.235]
true_rpy_deg = [0.7, 35.9, -0.8]
true_minus_gnss_s = 0.012
max_range_m = 20.0
"""
FEET = "{data}/foreign/08-tiff-heights-in-feet"
CASES = {
    "tractor_loop": "run {data}/tractor_loop/session.toml -o {result}",
    "tractor_fishtail": "run {data}/tractor_fishtail/session.toml -o {result}",
    "preview": "run {data}/tractor_loop/session.toml --preview -o {result}",
    "flight": "run {data}/uav_wheat/session.toml -o {result}",
    "flight_without_images": "run {inputs}/without_images/session.toml -o {result}",
    "flight_outage": "run {data}/uav_wheat/session_outage.toml -o {result}",
    "flight_degraded": "run {data}/uav_wheat/session_degraded.toml -o {result}",
    "rover": "run {data}/rover_imu/session.toml -o {result}",
    "two_scanners": "run {inputs}/two_scanners/session.toml -o {result}",
    "batch": "batch {inputs}/season -o {result} --workers 1",
    "parcels": "parcels {results}/flight/cloud.copc.laz {data}/uav_wheat/parcels.geojson -o {result}",
    "response": ("response {results}/flight/parcels.csv --treatments {data}/uav_wheat/treatments.csv -o {result}"),
    "cloud": "cloud {data}/las/good/las14_pf8_wkt_rgf93.laz -o {result}/cloud.copc.laz",
    "surface": "surface {data}/las/good/las14_pf8_wkt_rgf93.laz -o {result}",
    "surface_ground": "surface {data}/las/good/las12_pf3_autzen_trim.laz --dst-crs EPSG:32610 -o {result}",
    "features": "features {data}/las/good/las14_pf8_wkt_rgf93.laz -o {result}",
    "check": "check {data}/foreign/06-tiff-scale-offset/mm.tif {data}/foreign/06-tiff-scale-offset/points.csv --json",
    "check_feet": f"check {FEET}/compound.tif {FEET}/points_compound.csv --json",
}


def make_inputs(program: Path) -> None:
    """What is not among the samples: made once, so that both versions read the same files."""
    if INPUTS.is_dir():
        return
    made = INPUTS.with_suffix(".part")
    shutil.rmtree(made, ignore_errors=True)
    made.mkdir(parents=True)
    (made / "two_scanners.toml").write_text(TWO_SCANNERS, encoding="utf-8")
    simulate = [program, "simulate", made / "two_scanners.toml", "-o", made / "two_scanners"]
    subprocess.run(simulate, check=True)
    flight = SAMPLES / "uav_wheat"
    session = (flight / "session.toml").read_text(encoding="utf-8")
    before, _, camera = session.partition("[camera]")
    text = before + camera[camera.index("[parcels]") :]
    copy = shutil.copytree(flight, made / "without_images", ignore=shutil.ignore_patterns("images", "*.jpg"))
    (Path(copy) / "session.toml").write_text(text, encoding="utf-8")
    for name in ("tractor_loop", "tractor_fishtail"):
        shutil.copytree(SAMPLES / name, made / "season" / name)
    made.rename(INPUTS)


def make_results(checkout: Path, name: str) -> Path:
    """The path of the digest of all cases, as the furrowmap of a checkout computes them.

    All versions write to the same folder, whose path some products state; its name comes afterwards.
    """
    program = checkout / ".venv" / ("Scripts" if os.name == "nt" else "bin") / "furrowmap"
    make_inputs(program)
    results = CACHE / "results"
    shutil.rmtree(results, ignore_errors=True)
    results.mkdir(parents=True)
    for case, words in CASES.items():
        result = results / case
        places = {"data": SAMPLES, "inputs": INPUTS, "results": results, "result": result}
        arguments = [word.format(**places) for word in words.split()]
        result.mkdir()
        print(case, flush=True)
        done = subprocess.run([program, *arguments], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False)
        if done.returncode not in (0, 4):  # 4: the results contradict each other, or exceed what was required
            sys.exit(f"{done.stdout.decode(errors='replace')}\ngolden: {case} ended with {done.returncode}")
        if "--json" in arguments:
            (result / "said.json").write_bytes(done.stdout[done.stdout.index(b"{") :])
    digest = CACHE / f"{name}.json"
    folders = [results / case for case in CASES]
    subprocess.run([sys.executable, TOOL, "digest", *folders, "-o", digest], check=True)
    kept = CACHE / name
    shutil.rmtree(kept, ignore_errors=True)
    results.rename(kept)
    return digest


def commit_digest(commit: str) -> Path:
    """The path of the digest of a commit, made where there is none."""
    asked = ["git", "rev-parse", "--verify", f"{commit}^{{commit}}"]
    full = subprocess.run(asked, cwd=CHECKOUT, check=True, capture_output=True, text=True).stdout.strip()
    digest = CACHE / f"{full}.json"
    if not digest.is_file():
        tree = CHECKOUT / "build" / "golden"
        if not tree.is_dir():
            subprocess.run(["git", "worktree", "add", "--detach", tree, full], cwd=CHECKOUT, check=True)
        subprocess.run(["git", "checkout", "--quiet", "--detach", full], cwd=tree, check=True)
        subprocess.run([sys.executable, tree / "scripts" / "setup.py"], cwd=tree, check=True)
        make_results(tree, full)
    return digest


def main(commit: str = "") -> int:
    """Make results, and compare them with a commit's."""
    if not (SAMPLES.is_dir() and TOOL.is_file()):
        sys.exit(
            "golden: the sample recordings and the tool that digests results (../shared) are not beside this checkout"
        )
    before = commit_digest(commit) if commit else None
    after = make_results(CHECKOUT, "checkout")
    if before is None:
        print(f"The digest is {after}; make golden AGAINST=COMMIT compares.")
        return 0
    return subprocess.run([sys.executable, TOOL, "compare", before, after], check=False).returncode


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
