"""The daemon and the client of tests/api, under more load than one client makes."""
import importlib.util
import pathlib
import sys

API = pathlib.Path(__file__).parent.parent / "api"
sys.path.append(str(API))
spec = importlib.util.spec_from_file_location("api_conftest", API / "conftest.py")
api_conftest = importlib.util.module_from_spec(spec)
sys.modules["api_conftest"] = api_conftest
spec.loader.exec_module(api_conftest)
globals().update({name: value for name, value in vars(api_conftest).items()
                  if not name.startswith(("__", "pytest_"))})
