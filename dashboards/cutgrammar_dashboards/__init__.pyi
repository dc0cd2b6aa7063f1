from .film.film_files import write_film as write_film
from .film.frames import FilmSettings as FilmSettings
from .film.frames import film_frames as film_frames
from .film.stills import stills as stills
from .recording.recorder import Recorder as Recorder
