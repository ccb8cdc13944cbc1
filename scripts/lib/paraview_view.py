"""Opens a run in ParaView, coloured as in its plots.

    paraview --script=view.py         interactively
    pvbatch view.py picture.png       a picture, and a state file beside it
"""
import sys
from pathlib import Path

from paraview.simple import *  # noqa: F403

OUT = Path(@OUT@)
PARTS = @PARTS@  # part: (field, low, high)
IN_SPACE = @IN_SPACE@

view = GetActiveViewOrCreate("RenderView")  # noqa: F405
view.ViewSize = [1200, 800]
view.Background = [1.0, 1.0, 1.0]
view.UseColorPaletteForBackground = 0
view.OrientationAxesVisibility = int(IN_SPACE)
for part, (field, low, high) in PARTS.items():
    # ParaView 5.11 has two readers of XDMF; this one reads a mesh that changes from frame to frame.
    reader = XDMFReader(registrationName=part, FileNames=[str(OUT / f"{part}.xdmf")])  # noqa: F405
    reader.UpdatePipeline()
    on_cells = field in reader.CellData.keys()
    shown = Show(reader, view, "UnstructuredGridRepresentation")  # noqa: F405
    ColorBy(shown, ("CELLS" if on_cells else "POINTS", field))  # noqa: F405
    colours = GetColorTransferFunction(field)  # noqa: F405
    colours.ApplyPreset("Viridis (matplotlib)" if part == "fluid" else "Inferno (matplotlib)", True)
    colours.RescaleTransferFunction(low, high)
    shown.SetScalarBarVisibility(view, True)
    bar = GetScalarBar(colours, view)  # noqa: F405
    bar.TitleColor = bar.LabelColor = [0.0, 0.0, 0.0]
scene = GetAnimationScene()  # noqa: F405
scene.UpdateAnimationUsingDataTimeSteps()
times = list(scene.TimeKeeper.TimestepValues) if hasattr(scene.TimeKeeper.TimestepValues, "__iter__") else [scene.TimeKeeper.TimestepValues]
view.ViewTime = times[len(times) // 2]
ResetCamera(view)  # noqa: F405
if IN_SPACE:
    view.GetActiveCamera().Azimuth(35.0)
    view.GetActiveCamera().Elevation(20.0)
    ResetCamera(view)  # noqa: F405
Render(view)  # noqa: F405

if sys.argv[-1].endswith(".png"):
    picture = Path(sys.argv[-1])
    SaveScreenshot(str(picture), view)  # noqa: F405
    SaveState(str(picture.with_suffix(".pvsm")))  # noqa: F405
    print(f"{len(times)} frames, t = {times[0]:g} to {times[-1]:g} s; wrote {picture} and {picture.with_suffix('.pvsm')}")
