"""The mission kind "bridge-contact"."""

from skywright.missions.bridge_contact.task import BridgeContact
from skywright.run.folder_kind import FolderKind


class BridgeContactKind(FolderKind[BridgeContact]):
    """Press a probe on a structure, docked or flying, and slide it along."""

    task = BridgeContact
    needs = frozenset({"uav", "whole_body", "probe"})
