"""Torch devices that a user names, checked before any work starts."""

from typing import TYPE_CHECKING

from specklegen.core.errors import reject

if TYPE_CHECKING:
    import torch


def checked_device(field: str, device: "str | torch.device") -> "torch.device":
    """Return a torch device that can hold numbers here."""
    import torch

    try:
        checked = torch.device(device)
        torch.zeros(1, device=checked).item()
    except (RuntimeError, AssertionError, NotImplementedError, TypeError, ValueError) as error:
        reason = str(error).partition("\n")[0].partition(". ")[0].rstrip(".")
        reject(field, "a device that torch has here", str(device), f"{reason}.")
    return checked
