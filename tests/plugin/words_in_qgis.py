"""Runs inside QGIS: the texts of a JSON file in the words of the plugin's dialogs, as JSON.

Arguments: the folder with the plugin, the JSON file with a list of texts for each language, and nothing else.
"""

from __future__ import annotations

import importlib
import json
import sys
from pathlib import Path

from qgis.core import QgsApplication
from qgis.PyQt.QtCore import QCoreApplication

plugin, texts = (Path(word) for word in sys.argv[1:])
application = QgsApplication([], False)
application.initQgis()
sys.path.insert(0, str(plugin.parent))
install = importlib.import_module("furrowmap.translation").install_translator
words = importlib.import_module("furrowmap.dock_words").in_dock_words
answer = {}
for language, each in json.loads(texts.read_text(encoding="utf-8")).items():
    translator = install(language)
    answer[language] = [words(text) for text in each]
    if translator is not None:
        QCoreApplication.removeTranslator(translator)
sys.stdout.write(json.dumps(answer) + "\n")
application.exitQgis()
