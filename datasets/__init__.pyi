from .loading.cache import SpeckleCache as SpeckleCache
from .loading.stream import SpeckleStream as SpeckleStream
from .recipes.recipe import Recipe as Recipe
from .recipes.recipe_files import recipe_names as recipe_names
from .recipes.registry import load_recipe as load_recipe
from .store.generate import generate as generate
