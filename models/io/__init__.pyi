from .archive import load_archive as load_archive, save_archive as save_archive
from .files import atomic_path as atomic_path, write_json as write_json, write_text as write_text
from .loader_yaml import load_yaml as load_yaml, models_dir as models_dir
from .model_files import files_named_by as files_named_by
from .settings import setting_values as setting_values, with_settings as with_settings
