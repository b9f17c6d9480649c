"""Processor seconds until the explorer shows its first picture, and after each slider was moved by a step.

    python scripts/explorer_seconds.py

In a process of its own, without a browser and a server; kernels are compiled before, by another process. "First
picture": imports included, until the camera's image stands; "whole page": until all panels do. A row a slider: the mean
of a step up and a step down, whole page, and the slowest panel. Sliders that the medium or setup has not are left out.
"""

import argparse
import subprocess
import sys
import time


def once() -> None:
    """Measure in this process."""
    begun = time.process_time()
    from specklegen.explorer import page
    from specklegen.explorer.controls import CONTROLS, State, shown

    state = State()
    page._camera(state)
    print(f"first picture {time.process_time() - begun:.2f} s", flush=True)
    page.panels(state)
    print(f"whole page    {time.process_time() - begun:.2f} s", flush=True)
    print("| slider | s | slowest panel | s |\n|---|---|---|---|")
    for name in shown(state):
        steps = CONTROLS[name].steps
        at = steps.index(getattr(state, name))
        moved = [state._replace(**{name: steps[n]}) for n in (at + 1, at - 1) if 0 <= n < len(steps)]
        took = {title: 0.0 for title, _, _ in page._PANELS}
        for each in moved:
            for title, _, body in page._PANELS:
                begin = time.process_time()
                page._said(body, each)
                took[title] += (time.process_time() - begin) / len(moved)
        slowest = max(took, key=lambda title: took[title])
        print(f"| {name} | {sum(took.values()):.2f} | {slowest} | {took[slowest]:.2f} |", flush=True)


def main() -> None:
    """Command line."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--here", action="store_true", help=argparse.SUPPRESS)
    if options.parse_args().here:
        return once()
    for output in (subprocess.DEVNULL, None):  # the first compiles
        subprocess.run([sys.executable, __file__, "--here"], stdout=output, check=True)


if __name__ == "__main__":
    main()
