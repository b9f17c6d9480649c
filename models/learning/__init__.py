"""Networks, their inputs and losses, and their training."""
