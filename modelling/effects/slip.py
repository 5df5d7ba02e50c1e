"""Tyre slip or another damper in series with a shaft."""

from modelling.effects.kind import Kind, Parameter


class Slip(Kind):
    """A damper of ``coefficient`` (N·m·s/rad) in series: the spring relaxes (tyre slip, relaxation length)."""

    kind = "slip"
    tables = ("shafts",)
    parameters = {"coefficient": Parameter("N*m*s/rad", lower=1e-9)}

    def shaft(self, law, p, assembly):
        law.series = p["coefficient"]
