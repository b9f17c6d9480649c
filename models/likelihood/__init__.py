"""The likelihood of camera images, given the object and the slab: what no other generator can tell."""
