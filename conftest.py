"""What all tests share: hypothesis has no deadline, for a busy machine decides how long an example takes."""

from hypothesis import settings

settings.register_profile("project", deadline=None)
settings.load_profile("project")
