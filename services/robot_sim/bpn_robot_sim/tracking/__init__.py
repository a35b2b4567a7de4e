"""The paper's tracking task: a window that slides over a world in which a disc moves (section V-A-2)."""
