"""Export a policy: scripts/export.py RUN, for where there is no torch.

RUN is a run folder or a shipped policy. Written are actor.npz, which agents/numpy_actor.py plays with NumPy alone, and
policy.onnx, for which the package onnx is needed: pip install '.[export]'.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from agents import commands, runs


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", help="run folder or shipped policy")
    parser.add_argument("--folder", type=Path, help="where to (default: the run folder; runs/export/NAME if shipped)")
    options = parser.parse_args()
    source = runs.find_run(options.run)
    folder = options.folder or (Path("runs/export") / options.run if options.run in runs.SHIPPED_NAMES else source)

    from agents import load  # slow to import: after the check above
    from agents.export import write_numpy, write_onnx
    from agents.numpy_actor import FILE

    policy = load(source)
    write_numpy(policy, folder / FILE)
    print(f"for NumPy: {folder / FILE}")
    try:
        write_onnx(policy, folder / "policy.onnx")
        print(f"for ONNX: {folder / 'policy.onnx'}")
    except ModuleNotFoundError as error:
        print(f"no ONNX, which needs {error.name}: pip install '.[export]'")


if __name__ == "__main__":
    commands.run(main)
