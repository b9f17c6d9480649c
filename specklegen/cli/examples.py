"""Examples of every command, shown below its options; a test reads each as the command line would."""

EXAMPLES: dict[str, tuple[str, ...]] = {
    "recipes": ("recipes", "recipes --all", "recipes show through-slab", "recipes schema hidden-object"),
    "recipes show": ("recipes show through-slab", "recipes show setup.toml --set material.g=0.8"),
    "recipes schema": ("recipes schema hidden-object", "recipes schema through-slab"),
    "plan": ("plan through-slab", "plan through-slab --set material.g=0.8 --samples 4096", "plan setup.toml --verbose"),
    "physics render": (
        "physics render --tilts 5 --out stack", "physics render --scene scene.toml --seed 3 --out stack",
    ),
    "memory-effect": (
        "memory-effect --g 0.9 --g 0.95 --out curves",
        "memory-effect --lags 2 --out curves",
        "memory-effect --material skin --wavelength 0.806 --thickness 300",
        "memory-effect --scene scene.toml --out curves",
    ),
    "physics reflectance": ("physics reflectance --optical-depth 10 --g 0.9 --index 1.4",),
    "generate": (
        "generate through-slab --samples 4096 --out data/through-slab.zarr",
        "generate setup.toml --images my-images --out data/mine.zarr --processes 4",
        "generate through-slab --samples 1000000 --out data/shared.zarr --shard-range 3/16",
    ),
    "preview": ("preview through-slab --out sheet.png", "preview data/through-slab.zarr --samples 12"),
    "evaluate": ("evaluate runs/first/best.pt", "evaluate --recipe through-slab --samples 64 --out judged"),
    "store info": ("store info data/through-slab.zarr",),
    "store verify": (
        "store verify data/through-slab.zarr", "store verify data/through-slab.zarr --repair through-slab",
    ),
    "store export": ("store export data/through-slab.zarr --out npy",),
    "train": (
        "train through-slab --out runs/first --seconds 300",
        "train through-slab --images my-images --start packaged --out runs/mine --seconds 240",
        "train data/train.zarr --validation data/validation.zarr --out runs/second --network residual",
    ),
    "check recoverable": (
        "check recoverable through-slab", "check recoverable setup.toml --images my-images",
        "check recoverable photo.tif --dark 20 --camera camera.toml",
    ),
    "reconstruct": ("reconstruct frame.tif --setup setup.toml --out seen",),
    "retrieve": ("retrieve frame.tif --out seen.png", "retrieve frame.tif --grain 3 --extent 60 --region find"),
    "fit camera": ("fit camera --pairs bright_1.tif bright_2.tif --dark dark_1.tif dark_2.tif --out camera.toml",),
    "fit material": ("fit material --wavelength 0.5 --tilt tilts.csv --transmittance .79+-.02 --out my-bench.toml",),
    "fit setup": ("fit setup run1 --dark 20", "fit setup frame.tif --profile disc --picture spectrum.png"),
    "fit twin": (
        "fit twin run1 --dark 20 --out twin.toml --picture twin.png", "fit twin run1 --setup setup.toml --envelope fit",
    ),
    "check compare": ("check compare through-slab --out compared.png",),
    "check benchmark": ("check benchmark --list", "check benchmark mine.py:mine --task thin --samples 8"),
    "check measured": ("check measured list", "check measured get hidden-shapes --out shapes"),
    "check measured list": ("check measured list --json",),
    "check measured get": ("check measured get hidden-shapes", "check measured get five-digits --out digits"),
    "explore": ("explore", "explore --port 2718 --no-browser"),
}


def epilog(command: str) -> str:
    """Text below the options of a command, kept line by line."""
    return "\b\nExamples:\n" + "\n".join(f"  specklegen {words}" for words in EXAMPLES[command])
