"""A block → the bytes of an FMU, the same for the same block, always."""

from __future__ import annotations

import hashlib
import io
import platform
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, replace

from jinja2 import Environment, PackageLoader, StrictUndefined

from modelling.common.escape import c_identifier, xml
from modelling.fmu.block import Block, Contents
from modelling.fmu.build import SUFFIX, binary, folder
from modelling.fmu.description import description
from modelling.fmu.source import FILES, sources

LICENCE = """The files motion.c, slave.c, slave.h and fmi2.c or fmi3.c are part of rigmatch, MIT licence. model.c was
written by CasADi's code generator from the model whose values model.h holds.
"""


@dataclass(frozen=True)
class Fmu:
    """An FMU: its bytes, GUID, identifier, and the platform its binary is for: None where there is no C compiler."""

    content: bytes
    token: str
    identifier: str
    platform: str | None


def fmu(block: Block, fmi: str = "2.0", step: float = 1e-3) -> Fmu:
    """Write a block as an FMU for co-simulation.

    Parameters
    ----------
    block : Block
    fmi : str
        ``"2.0"`` or ``"3.0"``.
    step : float
        s, communication step to suggest.

    Raises
    ------
    InputError
        If there is a C compiler that does not work.
    RuntimeError
        If a compiler that works does not compile the sources.
    """
    clean = replace(block, title=xml(block.title))
    page = page_of("index.html", block=clean, fmi=fmi)
    return package(clean, fmi, step, page, lambda identifier, token: sources(clean, identifier, fmi, token))


def package(contents: Contents, fmi: str, step: float, page: str, code_of: Callable[[str, str], dict[str, str]]) -> Fmu:
    """An FMU of any contents.

    Parameters
    ----------
    contents : Contents
        With a title that XML can hold.
    fmi : str
        As in :func:`fmu`.
    step : float
        s, communication step to suggest.
    page : str
        HTML of the documentation.
    code_of : callable
        (identifier, token) → C files by name.
    """
    identifier = c_identifier(contents.name)
    token = _token(description(contents, identifier, fmi, "", step, ""), code_of(identifier, ""))
    code = code_of(identifier, token)
    files: dict[str, bytes] = {
        "modelDescription.xml": description(contents, identifier, fmi, token, step, FILES[fmi]).encode(),
        "documentation/index.html": page.encode(),
        "documentation/licenses/license.txt": LICENCE.encode(),
    }
    made = binary(code, FILES[fmi])
    if made is not None:
        files[f"binaries/{folder(fmi)}/{identifier}.{SUFFIX.get(platform.system().lower(), 'so')}"] = made
    files |= {f"sources/{name}": text.encode() for name, text in code.items()}
    if fmi == "3.0":
        files["sources/buildDescription.xml"] = _build_description(identifier).encode()
    return Fmu(_archive(files), token, identifier, folder(fmi) if made is not None else None)


def _token(described: str, code: dict[str, str]) -> str:
    """A GUID that follows from all that is in the FMU but its binary."""
    digest = hashlib.sha256("\0".join([described, *code.values()]).encode()).hexdigest()
    return "{" + "-".join((digest[:8], digest[8:12], digest[12:16], digest[16:20], digest[20:32])) + "}"


def page_of(template: str, **values: object) -> str:
    """HTML of the documentation from a template of ``sources/``."""
    made = Environment(
        loader=PackageLoader("modelling.fmu", "sources"), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    return made.get_template(template).render(**values) + "\n"


def _build_description(identifier: str) -> str:
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiBuildDescription fmiVersion="3.0">
  <BuildConfiguration modelIdentifier="{identifier}">
    <SourceFileSet language="C99">
      <SourceFile name="{FILES["3.0"]}"/>
    </SourceFileSet>
  </BuildConfiguration>
</fmiBuildDescription>
"""


def _archive(files: dict[str, bytes]) -> bytes:
    """A ZIP archive without a trace of when and where it was made."""
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(files):
            entry = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
            entry.compress_type, entry.create_system, entry.external_attr = zipfile.ZIP_DEFLATED, 3, 0o644 << 16
            archive.writestr(entry, files[name])
    return target.getvalue()
