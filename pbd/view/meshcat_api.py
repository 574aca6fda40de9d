"""What we use of meshcat, imported without the deprecation warning that its own import of zmq raises."""

import warnings

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)
    from meshcat import Visualizer
    from meshcat import __file__ as meshcat_file
    from meshcat.geometry import Geometry, MeshPhongMaterial
    from meshcat.geometry import Mesh as MeshcatMesh
    from meshcat.path import Path as ScenePath
    from meshcat.servers.zmqserver import MESHCAT_COMMANDS, WebSocketHandler, ZMQWebSocketBridge

__all__ = [
    "MESHCAT_COMMANDS",
    "Geometry",
    "MeshPhongMaterial",
    "MeshcatMesh",
    "ScenePath",
    "Visualizer",
    "WebSocketHandler",
    "ZMQWebSocketBridge",
    "meshcat_file",
]
