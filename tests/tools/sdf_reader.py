"""What libsdformat, the parser of Gazebo, makes of a world: python sdf_reader.py world.sdf, prints JSON.

Drake carries that library; it is read in a process of its own. Where the file breaks the format, the error
ends it.
"""

import json
import sys

from pydrake.geometry import SceneGraph
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant


def main(path):
    plant, scene = MultibodyPlant(0.001), SceneGraph()
    plant.RegisterAsSourceForSceneGraph(scene)
    models = Parser(plant, scene).AddModels(path)
    plant.Finalize()
    context = plant.CreateDefaultContext()
    found = {}
    for model in models:
        (body,) = plant.GetBodyIndices(model)
        body = plant.get_body(body)
        pose = plant.EvalBodyPoseInWorld(context, body)
        shapes = []
        for geometry in plant.GetCollisionGeometriesForBody(body):
            shape, inspector = None, scene.model_inspector()
            shape = inspector.GetShape(geometry)
            at = pose @ inspector.GetPoseInFrame(geometry)
            size = shape.size().tolist() if type(shape).__name__ == "Box" else None
            shapes.append(
                {"shape": type(shape).__name__, "size": size, "at": at.translation().tolist(),
                 "x": at.rotation().matrix()[:, 0].tolist()}
            )  # fmt: skip
        name = plant.GetModelInstanceName(model)
        found[name] = {"at": pose.translation().tolist(), "x": pose.rotation().matrix()[:, 0].tolist(),
                       "mass": body.default_mass(),
                       "shapes": shapes}  # fmt: skip
    print(json.dumps(found))


if __name__ == "__main__":
    main(sys.argv[1])
