"""Packaged recipes with few paths a kernel."""

from specklegen.datasets import load_recipe


def few_paths(name, count=1000):
    """Changes after which a recipe's kernels take ``count`` paths; none for thin screens, which trace no paths."""
    traced = "kernel_paths" in type(load_recipe(name).material).model_fields
    return {"material": {"kernel_paths": count}} if traced else {}


def quick_recipe(name, count=1000, **changes):
    """A packaged recipe, changed; what is given takes the place of its changes."""
    return load_recipe(name, {**few_paths(name, count), **changes})
