from .recording.recorder import Recorder as Recorder
from .recording.recorder import make_recorder as make_recorder
