"""Slow, independent ground truth; tests import it, and it never imports what it judges."""
