from .film.film_files import write_film as write_film
from .film.frames import FilmSettings as FilmSettings
from .film.frames import film_frames as film_frames
from .film.frames import key_frames as key_frames
from .recording.recorder import Recorder as Recorder
