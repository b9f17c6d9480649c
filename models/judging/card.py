"""Data card of the benchmark: the tasks, the data to learn from, and the licence."""

import json

from specklegen.core.display.escape import cell
from specklegen.models.judging.tasks import SEED, TASKS, VERSION


def card() -> str:
    """Data card of the benchmark, in Markdown: the tasks, the data to learn from, and the licence."""
    lines = [
        f"# Benchmark of specklegen, version {VERSION}", "",
        f"{len(TASKS)} tasks, each the first samples of the test split of a recipe, seed {SEED}, or images that come "
        "with the package; of \"measured frames\" images that a user fetches. "
        "A sample is a pure function of (recipe, seed, split, number): nothing else is downloaded, and "
        "`specklegen.models.benchmark` renders the images anew. The fingerprint is the SHA-256 of all that decides a "
        "pixel; a build that renders other images refuses the task.", "",
        "| task | images | what is new or hard | starts from | fingerprint |", "|---|---|---|---|---|",
        *(f"| {cell(t.name)} | {t.samples} | {cell(t.asks)} | `{t.base}` | `{t.fingerprint[:16]}` |" for t in TASKS),
        "",
        "**To learn from**: anything but the test splits of these recipes at this seed, and no character of "
        "569BFMTVWt, in any font (but in the tasks \"unseen media\" and \"seven families\"), no bars and no "
        "photographs. The `train` and `validation` splits of the recipes hold to that where they show characters.", "",
        "**What a function may use**: the image or film, pitches, wavelength, window, the numbers of the medium and "
        "its C_I. A method that does without C_I should say so beside its score.", "",
        "**Measured images**: those of \"measured frames\" alone, which nobody hands on, since their authors state no "
        "licence. All others are simulated, with the assumptions that docs/trust.md lists.", "",
        "**Licence**: recipes, tasks and what is rendered from them: MIT, as the package. Characters are outlines of "
        "fonts (DejaVu, STIX, Computer Modern) that this package carries, with their licences; "
        "silhouettes are of photographs that scikit-image carries, under the licences that it states.", "",
        "## Recipes", "",
    ]  # fmt: skip
    for each in TASKS:
        table = json.dumps(each.recipe().physics(), indent=2, sort_keys=True)
        lines += [f"### {each.name}", "", "```json", table, "```", ""]
    return "\n".join(lines)
