# SPDX-License-Identifier: GPL-2.0-or-later
"""Which layers and groups of a project the plugin opened: only these may it remove, and by their keys it knows them.

A layer's name is its title in the user's language, which the user may change; its key, such as "coverage", stays.
"""

from __future__ import annotations

from pathlib import Path

from qgis.core import QgsLayerTreeGroup, QgsLayerTreeLayer, QgsMapLayer, QgsProject, QgsProviderRegistry, QgsVectorLayer

KEY_PROPERTY = "furrowmap/key"
"""Property of a layer: what it is, by the name of the product's layer or file."""
OPENED_PROPERTY = "furrowmap/opened"
"""Property of a layer that the plugin opened: the layer's id. A copy that the user makes has another id."""
THEMES_PROPERTY = "furrowmap/themes"
"""Property of a group: the names of its map themes in QGIS, as a list."""


def mark(layer: QgsMapLayer, key: str) -> None:
    """Remember that the plugin opened a layer, and what it is."""
    layer.setCustomProperty(KEY_PROPERTY, key)
    layer.setCustomProperty(OPENED_PROPERTY, layer.id())


def own_vector(source: str, key: str, title: str, provider: str = "ogr") -> QgsVectorLayer:
    """A vector layer, opened and marked.

    QGIS 3.40 loses a GeoPackage (features -1) that it opens beside a copy of one of its layers and unsaved edits in
    another, and finds it when it opens it again.
    """
    layer = QgsVectorLayer(source, title, provider)
    if layer.isValid() and layer.featureCount() < 0:
        layer = QgsVectorLayer(source, title, provider)
    mark(layer, key)
    return layer


def key_of(layer: QgsMapLayer | None) -> str:
    """What a layer is; "" for one of the user's."""
    return str(layer.customProperty(KEY_PROPERTY) or "") if layer is not None else ""


def is_own(layer: QgsMapLayer | None) -> bool:
    """Whether the plugin opened a layer; a copy of it is the user's."""
    return layer is not None and layer.customProperty(OPENED_PROPERTY) == layer.id()


def may_go(layer: QgsMapLayer | None) -> bool:
    """Whether the plugin may remove a layer: it opened it, and the user has no edits in it that are not saved."""
    return is_own(layer) and not (isinstance(layer, QgsVectorLayer) and layer.isModified())


def nodes_by_key(group: QgsLayerTreeGroup) -> dict[str, QgsLayerTreeLayer]:
    """The nodes of the layers that the plugin opened in a group, by their keys."""
    nodes = [node for node in group.findLayers() if is_own(node.layer())]
    return {key_of(node.layer()): node for node in reversed(nodes)}  # the upper of two


def groups_with(project: QgsProject, key: str, value: str | None = None) -> list[QgsLayerTreeGroup]:
    """The groups with a property: of this value, or of any."""
    opened = [(group, group.customProperty(key)) for group in project.layerTreeRoot().findGroups(True)]  # noqa: FBT003 - within groups as well
    return [group for group, of in opened if of and value in (None, str(of))]


def is_in_tree(project: QgsProject, group: QgsLayerTreeGroup) -> bool:
    """Whether a group is still in the layer panel; one that was removed is not asked, since it is gone."""
    return any(group is other for other in project.layerTreeRoot().findGroups(True))  # noqa: FBT003


def emptied_group(project: QgsProject, key: str, value: str, name: str) -> tuple[QgsLayerTreeGroup, int]:
    """A group for the layers of a result, without those that the plugin opened before, and the place for new ones.

    Layers and groups of the user stay where they are in it. Without any the group becomes the topmost one.
    """
    kept = None
    place = 0
    for group in groups_with(project, key, value):
        first = _first_own(group)
        if take_out(project, group):
            kept, place = group, first
    if kept is None:
        kept = project.layerTreeRoot().insertGroup(0, name)
    kept.setName(name)
    kept.setCustomProperty(key, value)
    return kept, place


def take_out(project: QgsProject, group: QgsLayerTreeGroup) -> bool:
    """Remove the layers of a group that the plugin opened, with their map themes; the group too, if nothing is left.

    Returns whether something of the user's is left in it.
    """
    themes = project.mapThemeCollection()
    for name in group.customProperty(THEMES_PROPERTY) or []:
        themes.removeMapTheme(name)
    group.removeCustomProperty(THEMES_PROPERTY)
    project.removeMapLayers([node.layerId() for node in group.findLayers() if may_go(node.layer())])
    if group.children():
        return True
    group.parent().removeChildNode(group)
    return False


def hide_others(project: QgsProject, group: QgsLayerTreeGroup, keys: tuple[str, ...]) -> None:
    """Hide the plugin's layers in other groups with one of these properties."""
    for key in keys:
        for other in groups_with(project, key):
            if other == group:
                continue
            if all(is_own(node.layer()) for node in other.findLayers()):
                other.setItemVisibilityChecked(False)
                continue
            for node in nodes_by_key(other).values():
                node.setItemVisibilityChecked(False)


def only_own(project: QgsProject) -> bool:
    """Whether a project has no layers but those that the plugin opened, base maps among them."""
    layers = project.mapLayers().values()
    return all(is_own(layer) or layer.customProperty("furrowmap/basemap") for layer in layers)


def folder_of_layers(group: QgsLayerTreeGroup) -> Path | None:
    """The folder of the files that the plugin's layers of a group show; None if it is not there."""
    for node in nodes_by_key(group).values():
        layer = node.layer()
        path = QgsProviderRegistry.instance().decodeUri(layer.providerType(), layer.source()).get("path")
        if path and Path(path).parent.is_dir():
            return Path(path).parent
    return None


def _first_own(group: QgsLayerTreeGroup) -> int:
    """The place in a group of the first layer that the plugin opened."""
    children = group.children()
    own = (isinstance(node, QgsLayerTreeLayer) and is_own(node.layer()) for node in children)
    return next((place for place, is_ours in enumerate(own) if is_ours), 0)
