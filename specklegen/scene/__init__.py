"""Scenes: frozen, validated values that know no compiler."""
