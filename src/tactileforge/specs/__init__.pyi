from tactileforge.specs.published import SIMULATED as SIMULATED
from tactileforge.specs.published import SPECS as SPECS
from tactileforge.specs.published import pixel_spacing as pixel_spacing
from tactileforge.specs.published import simulation as simulation
from tactileforge.specs.published import spec as spec
