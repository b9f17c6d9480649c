from .coherence.transmission import transmission_matrix as transmission_matrix
from .mean.field import mean_field as mean_field
from .mean.reflectance import reflectance_transmittance as reflectance_transmittance
from .memory_effects.joint import joint_correlation as joint_correlation
from .memory_effects.mueller import mueller_matrix as mueller_matrix
from .memory_effects.temporal import temporal_correlation as temporal_correlation
from .samplers.covariance.covariance import covariance as covariance
from .samplers.covariance.covariance import covariance_blocks as covariance_blocks
