"""Reconstruction: phase retrieval, networks, and their evaluation.

Names load when they are first used.
"""

from typing import TYPE_CHECKING

from specklegen.lazy import lazily

if TYPE_CHECKING:
    from specklegen.models.evaluation import evaluate
    from specklegen.models.metrics import align, bootstrap, scores
    from specklegen.models.phase_retrieval import Retrieval, retrieve
    from specklegen.models.reconstructor import Reconstructor, load_pretrained
    from specklegen.models.recoverability import Verdict, recoverable
    from specklegen.models.training import Training, train

_HOME = {
    "Reconstructor": "reconstructor",
    "Retrieval": "phase_retrieval",
    "Training": "training",
    "Verdict": "recoverability",
    "align": "metrics",
    "bootstrap": "metrics",
    "evaluate": "evaluation",
    "load_pretrained": "reconstructor",
    "recoverable": "recoverability",
    "retrieve": "phase_retrieval",
    "scores": "metrics",
    "train": "training",
}
__all__ = [
    "Reconstructor",
    "Retrieval",
    "Training",
    "Verdict",
    "align",
    "bootstrap",
    "evaluate",
    "load_pretrained",
    "recoverable",
    "retrieve",
    "scores",
    "train",
]

__getattr__ = lazily(__name__, _HOME)
