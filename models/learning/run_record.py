"""Record of a run, so that nothing else continues it: settings, data and validation data.

Examples in memory are known by the SHA-256 of their tensors; a caller that knows their origin states it, and
then a difference has a name: a recipe's field, a seed, a split.
"""

import contextlib
import hashlib
import json
import uuid
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from torch import nn

from specklegen.core.errors import reject
from specklegen.core.whole_files import patiently, write_whole
from specklegen.datasets import SpeckleCache
from specklegen.datasets.store.files import json_bytes
from specklegen.datasets.store.identity import differences
from specklegen.datasets.store.locks import claim
from specklegen.models.learning.examples import Examples
from specklegen.models.learning.networks import network_content
from specklegen.models.learning.reconstructor import Reconstructor

_ALONE = "a folder of no other running training"


def digest_of(examples: Examples) -> str:
    """SHA-256 of inputs and targets."""
    digest = hashlib.sha256()
    for tensor in (examples.inputs, examples.targets):
        array = tensor.detach().cpu().contiguous().numpy()
        digest.update(f"{array.dtype} {array.shape} ".encode())
        digest.update(array.reshape(-1).view("u1").data)
    return digest.hexdigest()


def digest_of_weights(network: nn.Module) -> str:
    """SHA-256 of the weights of a network, by their names."""
    digest = hashlib.sha256()
    for name, weight in network.state_dict().items():
        digest.update(f"{name} {weight.dtype} {tuple(weight.shape)} ".encode())
        digest.update(weight.detach().cpu().contiguous().reshape(-1).numpy().view("u1").data)
    return digest.hexdigest()


def record(
    training: Any, data: Any, validation: Examples, about: Mapping[str, Any] | None,
    start: Reconstructor | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Collect what decides a run; JSON types only.

    Parameters
    ----------
    training : Training
        Settings.
    data
        Examples, or a function that makes batches, with an attribute ``identity`` if it can tell what of.
    validation
        Examples.
    about
        What the caller knows of "data" and "validation".
    start
        Model whose weights the run begins with.
    """
    held_out = {"sha256": digest_of(validation)}
    shown = {"sha256": digest_of(data)} if isinstance(data, Examples) else dict(getattr(data, "identity", {}))
    if shown.get("sha256") == held_out["sha256"]:
        reject("train validation", "other examples than the training data", "the training examples")
    facts = about or {}
    begins = {} if start is None else {
        "start": {"sha256": digest_of_weights(start.network), "trained_on": start.trained_on}
    }  # fmt: skip
    return json.loads(
        json.dumps(
            {
                "training": json.loads(training.canonical_json())
                | {"epochs": training.epochs} | network_content(training.network),
                "data": shown | dict(facts.get("data", {})),
                "validation": held_out | dict(facts.get("validation", {})),
                **begins,
            }
        ),
        parse_constant=str,
    )


def require_same_run(folder: Path, there: Mapping[str, Any], here: Mapping[str, Any]) -> None:
    """Refuse to go on with a run that was made with something else; more epochs are welcome."""
    old, new = (one["training"]["epochs"] for one in (there, here))
    allowed = {**there, "training": there["training"] | ({"epochs": new} if new > old else {})}
    fields = differences(allowed, here)
    if fields:
        reject(
            "train.folder", "a new folder, or that of a run with the same settings and data", str(folder),
            f"It differs in {'; '.join(fields)}. Choose another folder, or use these settings (more epochs "
            "are allowed).",
        )  # fmt: skip


@contextlib.contextmanager
def alone(folder: Path) -> Iterator[Callable[[], None]]:
    """Keep other processes from training in a folder meanwhile; give what refuses if one does all the same.

    Some network folders have locks that exclude nobody: the file ``owner`` then says who began last. That one goes on
    from the last checkpoint, and who began before is refused before it writes again.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with claim(folder / "lock", 0) as state:
        if state == "busy":
            reject("train.folder", _ALONE, str(folder), "Choose another folder, or wait.")
        owner, mine = folder / "owner", uuid.uuid4().hex.encode()
        write_whole(owner, mine)

        def require_own() -> None:
            with contextlib.suppress(FileNotFoundError):
                if patiently(owner.read_bytes) == mine:
                    return
            reject("train.folder", _ALONE, str(folder),
                   "Another process trains there now, from the last checkpoint; this one wrote nothing after it. File "
                   "locks do not work in this folder: train in a folder on a local disk.")  # fmt: skip

        yield require_own


def write_record(folder: Path, here: Mapping[str, Any]) -> None:
    """Write ``run.json`` into the folder of a run, for people."""
    write_whole(folder / "run.json", json_bytes(here))


def require_held_out(data: SpeckleCache, validation: SpeckleCache) -> None:
    """Refuse a store to validate on whose media or objects the network is trained on.

    Only splits are disjoint, by medium and by object, whatever the recipe and the seed.
    """
    trained, held_out = data.identity["split"], validation.identity["split"]
    if held_out == "train" or held_out == trained:
        reject(
            "train --validation", "a store of another split than the training data, and not of split train",
            f"{validation.folder}, of the split {held_out}",
            "Its media and objects are in the training data. Generate a store with --split validation.",
        )  # fmt: skip
