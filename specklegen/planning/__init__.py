"""Planning: scene and budget to a plan, from decisions that stand beside their physics."""
