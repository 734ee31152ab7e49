import pytest


class Spy:
    """A fake Meshcat: keeps the latest pose, properties and object of each path.

    Attributes:
        poses: Path -> pose.
        properties: (path, name) -> value.
        objects: Path -> shape, or vertices (N, 3) of a mesh.
        times: Path, or (path, name) -> the times [s] in the recording at which it was set.
        deleted: Paths that were deleted.
    """

    def __init__(self):
        self.poses, self.properties, self.objects, self.times = {}, {}, {}, {}
        self.deleted = []

    def SetTransform(self, path, pose, time=None):
        self.poses[path] = pose
        self.times.setdefault(path, []).append(time)

    def SetProperty(self, path, name, value, time=None):
        self.properties[path, name] = value
        self.times.setdefault((path, name), []).append(time)

    def SetObject(self, path, shape, color=None):
        self.objects[path] = shape

    def SetTriangleColorMesh(self, path, vertices, faces, colors):
        self.objects[path] = vertices.T

    def Delete(self, path):
        self.deleted.append(path)

    def visible(self, path):
        return self.properties[path, "visible"]


@pytest.fixture
def spy():
    return Spy()
