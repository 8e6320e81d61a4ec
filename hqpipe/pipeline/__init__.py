"""The pipeline half: graph, configuration and artifacts. It knows nothing of physics."""
