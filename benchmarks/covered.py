"""Hold a robot file's bodies against what is drawn of the robot, and keep what is found.

`s3le robot new` does this for the files that it makes. For robots of the package whose URDF holds
no record (one written by hand, or whose file must not change), this writes robots/covered.json:

    python benchmarks/covered.py coman coman.urdf --package-path iit-coman-ros-pkg
"""

import argparse
import json
import math
from pathlib import Path

from s3le.onboard import covering, reading, source
from s3le.robot.known import READY
from s3le.robot.robot import Robot
from s3le.safety import covered


def main() -> None:
    """Measure, print, and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("robot", help="robot file, or the name of one")
    parser.add_argument("drawn", type=Path, help="the maker's URDF or MJCF, with its meshes")
    parser.add_argument("--package-path", type=Path, action="append", default=[])
    args = parser.parse_args()
    robot = Robot.load(args.robot)
    origin = reading.read(args.drawn, args.package_path)
    own = {link.get("name"): link for link in robot.tree.findall("link")}
    if lost := [link for link in origin.drawn if link not in own]:
        parser.error(f"the robot file's URDF has no link {', '.join(lost)}, which is drawn")
    root = source.bare_of(robot.tree)
    for link in root.findall("link"):
        link.extend(own[link.get("name")].findall("collision"))
    found = covering.measure(source.model_of(args.drawn, root), root, origin.drawn)
    for item in found.values():
        print(f"{item.link:<28} {item.reach * 1e3:7.1f} mm {item.share:7.1%}")
    file = READY / "covered.json"
    every = json.loads(file.read_text())
    held = {bodies: entry for bodies, entry in every.items() if entry["robot"] != robot.name}
    links = {item.link: [_number(item.reach), _number(item.share)] for item in found.values()}
    held[covered.fingerprint(robot.tree)] = {
        "robot": robot.name, "allowance": covered.ALLOWANCE, "links": links
    }  # fmt: skip
    file.write_text(_text(held))


def _text(held: dict) -> str:
    """JSON with a line for each link."""
    entries = []
    for bodies, entry in held.items():
        rows = ",\n".join(f"      {json.dumps(k)}: {v}" for k, v in entry["links"].items())
        head = f'"robot": {json.dumps(entry["robot"])}, "allowance": {entry["allowance"]}'
        entries.append(f'  "{bodies}": {{{head}, "links": {{\n{rows}\n  }}}}')
    return "{\n" + ",\n".join(entries) + "\n}\n"


def _number(value: float) -> float:
    return float("nan") if math.isnan(value) else round(value, 6)


if __name__ == "__main__":
    main()
