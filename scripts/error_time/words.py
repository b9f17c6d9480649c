"""What the page says in words: why a curve flattens, why two cross, why an error cannot go lower."""

FLOORS = {
    "transmission-g09-od1": "Almost all light is scattered once or twice and straight on: nothing decorrelates.",
    "transmission-g09-od50": "The plain program pays for each of some 100 collisions a path; thinning keeps about one.",
    "oblique-view": "The stationary model takes K and I from the axis. At 20° both are others, whatever the paths: its "
    "curve flattens at that bias, and the planner refuses it here (`sampler=` overrides that).",
    "backscatter": "The closed form includes the cone: S + M + the same M between the reversed directions.",
    "wide-field": "No transform spans 80°: every connection is summed at every view, and the general engine for a "
    "few points is close.",
    "flatland-box": "The wave equation is not transport theory: single views differ by some per cent (1/(kℓ), "
    "docs/validation.md), so its curve flattens there; the others agree with the literal algorithm. Electric-field "
    "Monte Carlo has no reversed paths, and misses the backscattering peak.",
    "thin-box": "At optical depth 0.02 one scattering is nearly all: the closed form is exact for it and instant, and "
    "its error is the light that is scattered more often, which Monte Carlo passes after a while.",
    "near-field": "Every sensor point is also where paths may start; that, not the sum, takes the time.",
    "voxels": "Rays walk through voxels one by one.",
    "hidden-object-within": "Nine beams at once. The object sampler's modes leave out up to 1 % of the light, put back "
    "evenly: the only bias below the noise.",
    "hidden-object-beyond": "The same, with more modes; the tilt covariances judged are those between far pixels.",
}
"""Scene to a remark below its figure."""

CROSSINGS = {
    ("paths", "paths, direct sum"): "with few connections the direct sum costs less than setting up a transform",
    ("paths", "stationary"): "the same paths; the stationary sampler sums none of them at the views, but its model has "
    "a bias that paths do not have",
    ("paths", "covariance, few points"): "paths pay for every view and bring images; the general engine pays for the "
    "points alone but dearer for each collision",
    ("paths", "covariance, eigen-sampling"): "a matrix of all views costs more per path and its eigenvectors something "
    "once; the estimate is the same",
    ("covariance, few points", "covariance, eigen-sampling"): "the same estimator; a matrix of all views and its "
    "eigenvectors against a few points",
    ("stationary", "covariance, few points"): "the general engine is dearer a path but has no model bias",
    ("single scattering, closed form", "covariance, few points"): "the closed form is instant but stops at the light it "
    "leaves out",
    ("single scattering, closed form", "covariance, eigen-sampling"): "as for few points",
    ("single scattering, closed form", "paths"): "as for the covariance",
    ("naive Algorithm 2", "electric-field Monte Carlo"): "electric-field Monte Carlo runs only the points, in NumPy; "
    "what it cannot have at all is a correlation",
    ("wave solver", "naive Algorithm 2"): "the wave equation is dear a placement but each is a whole medium; it stops at "
    "its difference from transport theory",
    ("wave solver", "electric-field Monte Carlo"): "as for Algorithm 2",
}
"""Why two methods cross, in either order."""

GENERAL = "Both fall with slope −½; fixed costs and the cost of a path decide."


def crossing(one: str, other: str) -> str:
    """Why two curves cross."""
    if "wave solver" in (one, other):
        return CROSSINGS.get((one, other)) or CROSSINGS.get((other, one)) or (
            "the wave equation stops at its difference from transport theory"
        )
    return CROSSINGS.get((one, other)) or CROSSINGS.get((other, one)) or GENERAL
