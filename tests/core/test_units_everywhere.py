"""Public fields and parameters that sound like a length, an angle or a time take units, or are listed with why not."""

import importlib
import inspect
import pkgutil
import re

from pydantic import BaseModel

from specklegen import SUBJECTS, theory
from specklegen.core.quantities import _nodes_of, nodes_of

PACKAGES = ("", *(f".{name}" for name in SUBJECTS), ".datasets", ".fdtd", ".instrument", ".materials", ".measured",
            ".models", ".wavetracing",
            *(f".theory.{each.name}" for each in pkgutil.iter_modules(theory.__path__)))  # fmt: skip
QUANTITY = re.compile(
    r"(^|_)(wavelengths?|thickness|length|distance|widths?|pitch|shifts?|radius|radii|diameter|position|points?|center|"
    r"velocit\w*|speed|diffusion|lags?|times?|tau\w*|exposures?|tilts?|angles?|azimuth|theta|phi|bandwidths?|aperture|"
    r"waist|focal_length|gaps?|depths?|mean_free_path|extent|dx|dt|dz|frequency|frequencies|incidence|wavenumber\w*|"
    r"rate|duration|delay|spacing|origin|k|interval|offset|sigma|step)($|_)"
)
COUNTS = {"bit_depth", "learning_rate", "batch_size", "n_points", "optical_depth", "transport_depths", "a_over_sigma",
          "optical_depth_of_layer", "numerical_aperture", "training_width"}  # fmt: skip
"""Numbers of another kind: counts, ratios, bits."""
COMPUTED = {
    "CameraFit", "CoherentTransmission", "EquivalentSlab", "ExposureContrast", "ImageRetrieval", "Incidence", "Joint",
    "JointCorrelation", "Lobes", "MeanField", "MemoryEffect", "MemoryRange", "MultiExposureFit", "MuellerMatrix",
    "PhotographVerdict", "RayPath", "ReflectanceTransmittance", "Replacement", "ScatteredField", "SetupFit",
    "SingleDelay", "TemporalCorrelation", "Verdict",
}  # fmt: skip
"""Results: nobody gives their fields."""
REASONS = {
    "camera pixels": {"Optics.step", "Retrieval.extent", "fit_setup.target_step", "measured_memory_effect.distance",
                      "autocorrelation.sigma", "multiframe_deconvolution.sigma", "periodogram.sigma",
                      "retrieve_image.extent",
                      "SpeckleLikelihood.of_lags.lags"},
    "shares of the pupil's radius": {"Pupil.waist"},
    "multiples of the duration": {"Pulse.delay"},
    "counts of a camera": {"Camera.offset"},
    "channels of a network, or a part that is no number": {"Reconstructor.width", "Training.width", "Solver.points",
                                                           "Recipe.exposure"},
    "phase of a grid's cell": {"out_of_phase.theta"},
    "T / tau0, a ratio": {"class_contrast_squared.exposure"},
    "a direction sine": {"gathered.width", "memory_effect_between.pitch"},
    "in the unit of a correlation that was computed": {"memory_effect_between.wavelength"},
    "in micrometres, as presets are written": {"Preset.wavelengths"},
    "metres alone, as all of a coverage map": {"Transmitter.position"},
    "called with numbers by tracers and samplers": {
        "Light.field.points", "PlaneWave.field.points", "WaveSum.field.points", "GaussianBeam.field.points",
        "GaussianLaser.field.points", "GaussianLaser.lights.points", "PointEmitter.field.points",
        "PointEmitter.lights.points", "CollimatedEmitter.lights.points", "Cone.contains.points", "Cone.region.depth",
        "Cone.region.half_depth", "Mask.quadrature.wavelength", "Imaging.require_lens.wavelength",
        "Mie.exact_amplitude.theta", "Scatterer.exact_amplitude.theta",
        "Motion.mean_square.lag", "Absorber.row.wavelength", "Building.row.wavelength",
        "Conductor.row.wavelength", "Diffuse.row.wavelength", "Smooth.row.wavelength",
    },
    "in the unit of vertices, which come from files": {"Mesh.placed.shift"},
}  # fmt: skip
KNOWN = {name: reason for reason, names in REASONS.items() for name in names}


def things():
    for package in PACKAGES:
        module = importlib.import_module(f"specklegen{package}")
        own = (name for name, each in vars(module).items() if getattr(each, "__module__", "") == module.__name__)
        for name in getattr(module, "__all__", None) or own:
            if not name.startswith("_") and callable(getattr(module, name)):
                yield name, getattr(module, name)


def parameters(thing):
    """Names of what is given, with those that have a dimension and take texts."""
    if inspect.isclass(thing):
        takes = issubclass(thing, BaseModel) or isinstance(vars(thing).get("__new__"), staticmethod) or (
            hasattr(thing, "has_quantities"))  # fmt: skip
        made = inspect.signature(thing).parameters if inspect.isfunction(thing.__init__) else thing.__annotations__
        names = getattr(thing, "model_fields", made)
        nodes = nodes_of(thing) if takes else {}
    else:
        thing = getattr(thing, "__func__", thing)
        names, wrapped = inspect.signature(thing).parameters, hasattr(thing, "__wrapped__")
        nodes = _nodes_of(inspect.unwrap(thing)) if wrapped else {}
    return names, {name for name, node in nodes.items() if node.dimension is not None}


def untold():
    """Public names that sound like a quantity and take no unit."""
    for name, thing in things():
        inner = {name: thing}
        if inspect.isclass(thing) and name not in COMPUTED:
            methods = {each: vars(thing)[each] for each in vars(thing) if not each.startswith("_")}
            inner |= {f"{name}.{each}": method for each, method in methods.items()
                      if inspect.isfunction(getattr(method, "__func__", method))}  # fmt: skip
        for place, each in inner.items():
            names, taken = ((), ()) if place in COMPUTED else parameters(each)
            yield from (f"{place}.{one}" for one in names
                        if QUANTITY.search(one) and one not in taken and one not in COUNTS)  # fmt: skip


def test_every_public_quantity_takes_units_or_says_why_not():
    found = set(untold())
    assert found == KNOWN.keys(), sorted(found ^ KNOWN.keys())


def test_a_parameter_that_lost_its_dimension_is_caught(monkeypatch):
    import specklegen as sg
    from specklegen.theory import focused_light

    monkeypatch.setattr(focused_light, "gaussian_focus", inspect.unwrap(focused_light.gaussian_focus))
    monkeypatch.setitem(sg.Slab.model_fields, "mean_path_length", sg.Slab.model_fields["albedo"])
    assert {"gaussian_focus.waist", "Slab.mean_path_length"} <= set(untold())
