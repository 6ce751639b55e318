"""Registers the environment with Gymnasium, which calls this when it is imported; light, for it always does."""


def register() -> None:
    """Make ``fsw/Weld-v0`` known."""
    import gymnasium

    if "fsw/Weld-v0" not in gymnasium.registry:
        gymnasium.register(
            id="fsw/Weld-v0",
            entry_point="fsw.weld_env:WeldEnv",
            vector_entry_point="fsw.weld_env:WeldVectorEnv",
        )
