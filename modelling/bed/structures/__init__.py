"""Control structures, one a file; a new one is registered by its line here."""

from modelling.bed.loop import ControlStructure
from modelling.bed.structures.model_based import ModelBased
from modelling.bed.structures.observer import Observer
from modelling.bed.structures.pi import PI

STRUCTURES: dict[str, ControlStructure] = {structure.name: structure for structure in (PI(), ModelBased(), Observer())}
DEFAULT = ModelBased.name  # of a case that names none
