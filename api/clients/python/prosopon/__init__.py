"""Client of the Prosopon API; needs only the standard library.

    from prosopon import Client
    client = Client("http://127.0.0.1:8080")
    session = client.create_session(label="case 1")
    client.put_surface(session["id"], "skin", "skin.stl")
    job = client.wait(client.build_field(session["id"]))

Coordinates are patient LPS in mm. Every error answer of the service raises `Problem`.
"""

from ._client import Client, SurfacePart
from ._follow import JobEvent, has_ended
from ._frame import Frame, decode_frame, decode_topology
from ._problem import JobFailed, Problem, Unreachable

__all__ = [
    "Client",
    "Frame",
    "JobEvent",
    "JobFailed",
    "Problem",
    "SurfacePart",
    "Unreachable",
    "decode_frame",
    "decode_topology",
    "has_ended",
]
