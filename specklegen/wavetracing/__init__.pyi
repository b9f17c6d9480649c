from .wedge import geometric_shares as geometric_shares
from .wedge import wedge_coefficients as wedge_coefficients
from .wedge import wedge_field as wedge_field
