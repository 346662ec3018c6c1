"""Write a robot and its protocols for other programs: the export folder, its clips, and what several writers use."""
