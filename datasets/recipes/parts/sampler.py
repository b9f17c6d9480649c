"""The sampler that a recipe asks for, and the number by which samples store the one that made them."""

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import PlainSerializer, PlainValidator, SerializationInfo, WithJsonSchema

from specklegen.core.content import content_digest, is_own
from specklegen.core.errors import reject
from specklegen.core.registry import is_import_path
from specklegen.core.values import CONTENT_KEY, for_identity
from specklegen.planning.planning import PACKAGED
from specklegen.samplers.sampler import SAMPLERS, AnySampler, MediaSampler, Sampler, asked_sampler

NUMBERS = {"paths": 1, "stationary": 2, "screens": 3, "convolution": 4}
"""Numbers that samples store, of the samplers of this library; ..."""
OWN = 0
"""... and that of one of a user's own, which the recipe names."""


def number_of(sampler: Sampler) -> int:
    """Number by which samples store a sampler."""
    return OWN if is_own(type(sampler)) else NUMBERS[sampler.name]


def _asked(asked: Any) -> AnySampler:
    """Name of a sampler of this library, or class of a user's own: from either, an import path, or what stores hold."""
    stated = None
    if isinstance(asked, Mapping):
        asked, stated = asked.get("type"), asked.get(CONTENT_KEY)
    able = [name for name in SAMPLERS if issubclass(SAMPLERS[name], MediaSampler)]
    if isinstance(asked, str) and asked not in ("auto", *able) and not is_import_path(asked):
        raise ValueError(f"one of {', '.join(map(repr, ['auto', *able]))}")
    kind = asked_sampler("Recipe.sampler", asked)
    if kind is None:
        return "auto"
    if not issubclass(kind, MediaSampler):
        reject("Recipe.sampler", "a sampler with prepare_media", kind.name,
               "Derive it from MediaSampler, and define prepare_media.")  # fmt: skip
    if not is_own(kind):
        return kind.name
    digest = content_digest(kind)
    if stated not in (None, digest):
        reject("Recipe.sampler", f"unchanged, with SHA-256 {str(stated)[:12]}", digest[:12],
               "Its class has changed since this was written: restore the class, or generate the "
               "data again.")  # fmt: skip
    return kind


_NAMES = ["auto", *(kind.name for kind in PACKAGED if issubclass(kind, MediaSampler))]
_asked.names = _NAMES  # type: ignore[attr-defined]  # which signatures show


def _written(asked: AnySampler, info: SerializationInfo) -> object:
    if isinstance(asked, str):
        return asked
    wanted = for_identity(info)
    return {"type": asked.name, CONTENT_KEY: content_digest(asked)} if wanted else asked.name


RecipeSampler = Annotated[
    Any,
    PlainValidator(_asked),
    PlainSerializer(_written),
    WithJsonSchema({"anyOf": [{"enum": _NAMES}, {"type": "string"}]}),
]
"""A sampler that renders recipes, or "auto"; one of a user's own counts by its content."""
