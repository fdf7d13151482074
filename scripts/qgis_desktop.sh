#!/usr/bin/env bash
# Starts the real desktop QGIS on a virtual screen, with a fresh profile and the plugin, and runs a script in it:
#   qgis_desktop.sh PLUGINS SCRIPT.py [ARGUMENT]...
# PLUGINS is the folder that holds the plugin's folder `furrowmap`. The script finds `iface` and its arguments as
# `arguments`, calls `leave()` when it is done (`leave` may be called by a timer later), and may call `shot(PATH)`.
# QGIS_SIZE=1600x1000 is the screen's size, QGIS_LOCALE=en its language, QGIS_INTERPRETER the worker's command.
# Prints what the script prints. Ends with QGIS's own status; 1 where the script raised an exception. A crash of QGIS after it
# has unloaded every plugin is told, and counts as an end.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
[ -f /etc/qgis-root ] || exec scripts/in_qgis_root.sh bash scripts/qgis_desktop.sh "$@"

plugins=$1 script=$2; shift 2
work=$(mktemp -d -p "$XDG_RUNTIME_DIR")
ini=$work/profiles/default/QGIS/QGIS3.ini
mkdir -p "${ini%/*}" "$work/home"
version=$(python3 -c 'from qgis.core import Qgis; print(Qgis.QGIS_VERSION_INT // 100)' 2>/dev/null)
cat >"$ini" <<INI
[locale]
userLocale=${QGIS_LOCALE:-en}
overrideFlag=true
[qgis]
checkVersion=false
showTips$version=false
enableMacros=Never
[app]
askToSaveProjectChanges=false
askToSaveMemoryLayers=false
[plugin_installer]
checkOnStart=false
[plugin-manager]
automatically-check-for-updates=false
[core]
NewsFeed\\httpsfeedqgisorg\\disabled=true
NewsFeed\\http00008000\\disabled=true
[furrowmap]
interpreter=${QGIS_INTERPRETER-}
[PythonPlugins]
processing=true
furrowmap=true
INI

cat >"$work/start.py" <<'PY'
import os
import sys
import faulthandler
import traceback

import qgis.utils
from qgis.core import QgsApplication, QgsProject
from qgis.PyQt.QtCore import QTimer
from qgis.utils import iface

faulthandler.enable()
# A thread of QGIS that was the first to ask for its store of passwords uses it after it is freed, if it ends while QGIS does
# (3.40, seen with valgrind); the main thread does not.
QgsApplication.authManager().isDisabled()
_unload = qgis.utils.unloadPlugin


def _unloaded(name):
    """QGIS's own `unloadPlugin`; tells when no plugin is left. What QGIS destroys after that has no code of a plugin.

    QGIS 3.40 never ends Python: `atexit` does not run.
    """
    done = _unload(name)
    if not qgis.utils.active_plugins:
        open(os.path.join(os.environ["DESKTOP_WORK"], "ended"), "w").close()
    return done


qgis.utils.unloadPlugin = _unloaded


def shot(path):
    """A picture of the whole screen."""
    QgsApplication.processEvents()
    screen = QgsApplication.primaryScreen()
    assert screen.grabWindow(0).save(str(path))


def leave():
    """Quit QGIS as its user would."""
    for window in QgsApplication.topLevelWidgets():
        if window is not iface.mainWindow() and window.isVisible():
            window.close()
    QgsProject.instance().clear()
    QTimer.singleShot(200, iface.actionExit().trigger)


def _fail(kind, error, trace):
    traceback.print_exception(kind, error, trace)
    sys.stderr.flush()
    with open(os.path.join(os.environ["DESKTOP_WORK"], "failed"), "w") as file:
        file.write("failed")
    leave()


def _begin():
    sys.excepthook = _fail
    iface.mainWindow().showMaximized()
    path, *arguments = os.environ["DESKTOP_COMMAND"].split("\x1f")
    scope = {"__name__": "__desktop__", "__file__": path, "iface": iface, "arguments": arguments}
    scope |= {"shot": shot, "leave": leave}
    globals()["_scope"] = scope
    try:
        exec(compile(open(path, encoding="utf-8").read(), path, "exec"), scope)
    except BaseException:
        _fail(*sys.exc_info())


QTimer.singleShot(500, _begin)
PY

mkdir -p /tmp/.X11-unix
exec 3<>"$work/display"
Xvfb -displayfd 3 -screen 0 "${QGIS_SIZE:-1600x1000}x24" -nolisten tcp +extension GLX >"$work/xvfb.log" 2>&1 &
for _ in $(seq 100); do [ -s "$work/display" ] && break; sleep 0.1; done
[ -s "$work/display" ] || { cat "$work/xvfb.log" >&2; exit 1; }
DISPLAY=:$(cat "$work/display"); export DISPLAY
openbox >/dev/null 2>&1 &
command=$(printf '%s\x1f' "$(realpath "$script")" "$@")
status=0
DESKTOP_WORK=$work DESKTOP_COMMAND=${command%?} PYTHONUNBUFFERED=1 QT_QPA_PLATFORM=xcb HOME=$work/home \
  QGIS_PLUGINPATH=$(realpath "$plugins") \
  qgis --profiles-path "$work" --nologo --noversioncheck --code "$work/start.py" \
  2> >(grep --line-buffered -vE 'propagateSizeHints|^$' >&2) || status=$?
kill $(jobs -p) 2>/dev/null || true
if [ "$status" -gt 128 ] && [ -e "$work/ended" ]; then
  echo "qgis_desktop.sh: QGIS itself crashed while it ended, after every plugin was unloaded" >&2
  status=0
fi
[ ! -e "$work/failed" ] || status=1
exit "$status"
