"""Processor seconds until the explorer shows its first picture, and after each slider was moved by a step.

    python scripts/explorer_seconds.py

In a process of its own, without a browser and a server; kernels are compiled before, by another process. "First
picture": imports included, until the camera's image stands; "whole page": until all panels do. A row a slider: the mean
of a step up and a step down, all panels of its view, and the slowest of them. Sliders of other media and setups
are left out.
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

    page._camera(State())
    print(f"first picture {time.process_time() - begun:.2f} s", flush=True)
    page.panels(State())
    print(f"whole page    {time.process_time() - begun:.2f} s", flush=True)
    print("| view | slider | s | slowest panel | s |\n|---|---|---|---|---|")
    for view in CONTROLS["view"].steps:
        state = State(view=view)
        took(state)
        for name in shown(state):
            if name == "view":
                continue
            steps = CONTROLS[name].steps
            at = steps.index(getattr(state, name))
            taken = [took(state._replace(**{name: steps[n]})) for n in (at + 1, at - 1) if 0 <= n < len(steps)]
            mean = {title: sum(each[title] for each in taken) / len(taken) for title in taken[0]}
            slowest = max(mean, key=lambda title: mean[title])
            print(f"| {view} | {name} | {sum(mean.values()):.2f} | {slowest} | {mean[slowest]:.2f} |", flush=True)


def took(state) -> dict[str, float]:
    """Processor seconds of each panel of a state's view."""
    from specklegen.explorer import page

    seconds = {}
    for title, _, body, views in page._PANELS:
        if state.view in views:
            begin = time.process_time()
            page._said(body, state)
            seconds[title] = time.process_time() - begin
    return seconds


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
