<?xml version="1.0" encoding="utf-8"?>
<!DOCTYPE TS>
<TS version="2.1" language="de">
<context>
  <name>Algorithms</name>
  <message><source>A connection URI such as postgresql://me@server/farm, instead of a GeoPackage. Keep passwords in PostgreSQL's password file.</source><translation>Eine Verbindungs-URI wie postgresql://me@server/farm statt eines GeoPackages. Passwörter gehören in die Passwortdatei von PostgreSQL.</translation></message>
  <message><source>A name, or a file to pass on that ends with .toml.</source><translation>Ein Name oder, zum Weitergeben, eine Datei mit der Endung .toml.</translation></message>
  <message><source>A project for QField instead of a web page</source><translation>Ein Projekt für QField statt einer Webseite</translation></message>
  <message><source>A surface or terrain model (GeoTIFF), or a cloud of bare soil.</source><translation>Ein Oberflächen- oder Geländemodell (GeoTIFF) oder eine Punktwolke des unbewachsenen Bodens.</translation></message>
  <message><source>A surface through the bare soil around the parcels (default), or a plane around each.</source><translation>Eine Fläche durch den unbewachsenen Boden um die Parzellen (Vorgabe) oder eine Ebene um jede.</translation></message>
  <message><source>A table of the images and their times (CSV: file, time_unix_s), or one of the images, to use all in its folder with their EXIF times.</source><translation>Eine Tabelle der Bilder mit ihren Zeiten (CSV: file, time_unix_s) oder eines der Bilder, um alle seines Ordners mit ihren EXIF-Zeiten zu verwenden.</translation></message>
  <message><source>Accuracy</source><translation>Genauigkeit</translation></message>
  <message><source>Add results to the farm map</source><translation>Ergebnisse zur Betriebskarte hinzufügen</translation></message>
  <message><source>Adds the results of runs to a farm map, a GeoPackage or a PostGIS database, which is created if it does not exist. Sessions that the farm map contains are replaced by the new result. If one of them fails, nothing is changed.</source><translation>Fügt die Ergebnisse von Auswertungen einer Betriebskarte hinzu, einem GeoPackage oder einer PostGIS-Datenbank, die bei Bedarf angelegt wird. Sitzungen, die sie schon enthält, werden durch das neue Ergebnis ersetzt. Schlägt eine davon fehl, bleibt alles unverändert.</translation></message>
  <message><source>Adds them to the project when the algorithm has finished.</source><translation>Fügt sie dem Projekt hinzu, sobald der Algorithmus fertig ist.</translation></message>
  <message><source>Aligns the results of one field with each other on the ground that no tool touched in between, in height, tilt and place, and measures the soil moved from each date to the next, with standard deviations.</source><translation>Richtet die Ergebnisse eines Felds an dem Boden, den dazwischen kein Gerät berührte, in Höhe, Neigung und Lage aneinander aus und misst den von Zeitpunkt zu Zeitpunkt bewegten Boden mit Standardabweichungen.</translation></message>
  <message><source>Alley</source><translation>Weg</translation></message>
  <message><source>Allow damaged</source><translation>Beschädigtes zulassen</translation></message>
  <message><source>Allow large</source><translation>Große Dateien zulassen</translation></message>
  <message><source>Also compute the published method.</source><translation>Auch das veröffentlichte Verfahren rechnen.</translation></message>
  <message><source>Analyse the response of a trial</source><translation>Die Wirkung in einem Versuch auswerten</translation></message>
  <message><source>Angles of the board's axes in the vehicle frame, in degrees, in the first frame.</source><translation>Winkel der Tafelachsen im Fahrzeugsystem, in Grad, im ersten Bild.</translation></message>
  <message><source>Another log of the same drive, or a trajectory.</source><translation>Ein anderes Log derselben Fahrt oder eine Trajektorie.</translation></message>
  <message><source>Antenna offset (m)</source><translation>Antennenversatz (m)</translation></message>
  <message><source>Attitude of a mount from images of a chessboard</source><translation>Lage einer Halterung aus Bildern eines Schachbretts</translation></message>
  <message><source>Attitude of the mount</source><translation>Lage der Halterung</translation></message>
  <message><source>Average overlapping sessions instead of using the latest.</source><translation>Überlappende Sitzungen mitteln, statt die letzte zu verwenden.</translation></message>
  <message><source>Azimuth</source><translation>Azimut</translation></message>
  <message><source>Base station (RINEX)</source><translation>Basisstation (RINEX)</translation></message>
  <message><source>Between the centres of the rear tyres, in metres.</source><translation>Zwischen den Mitten der Hinterreifen, in Metern.</translation></message>
  <message><source>Blocks</source><translation>Blöcke</translation></message>
  <message><source>By default all layers.</source><translation>Vorgabe: alle Ebenen.</translation></message>
  <message><source>By default beside the results. Formats with one layer per file need a folder.</source><translation>Vorgabe: neben den Ergebnissen. Formate mit einer Ebene je Datei brauchen einen Ordner.</translation></message>
  <message><source>COPC file to write.</source><translation>Zu schreibende COPC-Datei.</translation></message>
  <message><source>CRS of a new farm map</source><translation>KBS einer neuen Betriebskarte</translation></message>
  <message><source>CRS of a new farm map, such as EPSG:6677 [default: the first session's].</source><translation>KBS einer neuen Betriebskarte, etwa EPSG:25832 [Vorgabe: das der ersten Sitzung].</translation></message>
  <message><source>CRS of a point cloud whose file states none.</source><translation>KBS einer Punktwolke, deren Datei keines nennt.</translation></message>
  <message><source>CRS of all products [default: that of the sessions].</source><translation>KBS aller Produkte [Vorgabe: das der Sitzungen].</translation></message>
  <message><source>CRS of clouds without one</source><translation>KBS von Punktwolken ohne Angabe</translation></message>
  <message><source>CRS of input files without one.</source><translation>KBS von Eingabedateien ohne Angabe.</translation></message>
  <message><source>CRS of points, or of a point cloud, whose file states none [default: that of the product].</source><translation>KBS von Punkten oder einer Punktwolke, deren Datei keines nennt [Vorgabe: das des Produkts].</translation></message>
  <message><source>CRS of the clean point cloud</source><translation>KBS der bereinigten Punktwolke</translation></message>
  <message><source>CRS of the mosaic</source><translation>KBS des Mosaiks</translation></message>
  <message><source>CRS of the output</source><translation>KBS der Ausgabe</translation></message>
  <message><source>CRS of the output, in metres [default: that of the input].</source><translation>KBS der Ausgabe, in Metern [Vorgabe: das der Eingabe].</translation></message>
  <message><source>CRS of the point cloud</source><translation>KBS der Punktwolke</translation></message>
  <message><source>CRS of the points</source><translation>KBS der Punkte</translation></message>
  <message><source>CRS of the raster [default: that of the surfaces].</source><translation>KBS des Rasters [Vorgabe: das der Oberflächen].</translation></message>
  <message><source>CRS of the surfaces</source><translation>KBS der Oberflächen</translation></message>
  <message><source>CRS of the vector layers, such as EPSG:4326 [default: the session's].</source><translation>KBS der Vektorebenen, etwa EPSG:4326 [Vorgabe: das der Sitzung].</translation></message>
  <message><source>CRS of the vectors</source><translation>KBS der Vektoren</translation></message>
  <message><source>CSV or GeoPackage.</source><translation>CSV oder GeoPackage.</translation></message>
  <message><source>CSV or spreadsheet with what each parcel or treatment received.</source><translation>CSV-Datei oder Tabellenkalkulation mit dem, was jede Parzelle oder Variante erhielt.</translation></message>
  <message><source>Calibrate the mounting</source><translation>Den Einbau kalibrieren</translation></message>
  <message><source>Calibrations of antennas (ANTEX)</source><translation>Antennenkalibrierungen (ANTEX)</translation></message>
  <message><source>Calibrations of antennas (ANTEX, such as igs20.atx): positions are then from marker to marker.</source><translation>Antennenkalibrierungen (ANTEX, etwa igs20.atx): Die Positionen gelten dann von Punkt zu Punkt.</translation></message>
  <message><source>Cancelled; no partial files are left.</source><translation>Abgebrochen; es bleiben keine unvollständigen Dateien zurück.</translation></message>
  <message><source>Canopy</source><translation>Bestand</translation></message>
  <message><source>Canopy height</source><translation>Bestandeshöhe</translation></message>
  <message><source>Captures, bags, GNSS logs, trajectories, point clouds.</source><translation>Paketaufzeichnungen, Bags, GNSS-Logs, Trajektorien, Punktwolken.</translation></message>
  <message><source>Cell size</source><translation>Zellgröße</translation></message>
  <message><source>Cell size [default: the smallest round size with four points per cell].</source><translation>Zellgröße [Vorgabe: die kleinste runde Größe mit vier Punkten je Zelle].</translation></message>
  <message><source>Cell size of the mosaics [default: that of the latest surface].</source><translation>Zellgröße der Mosaike [Vorgabe: die der letzten Oberfläche].</translation></message>
  <message><source>Cell size.</source><translation>Zellgröße.</translation></message>
  <message><source>Cell statistic</source><translation>Zellstatistik</translation></message>
  <message><source>Change between dates</source><translation>Änderung zwischen Zeitpunkten</translation></message>
  <message><source>Change between dates of one field</source><translation>Änderung zwischen Zeitpunkten eines Felds</translation></message>
  <message><source>Chart of the response</source><translation>Diagramm der Wirkung</translation></message>
  <message><source>Check against surveyed points</source><translation>Gegen eingemessene Punkte prüfen</translation></message>
  <message><source>Class codes to leave out, such as 64,65</source><translation>Auszulassende Klassen, etwa 64,65</translation></message>
  <message><source>Class codes to use, such as 2,9</source><translation>Zu verwendende Klassen, etwa 2,9</translation></message>
  <message><source>Classified point cloud</source><translation>Klassifizierte Punktwolke</translation></message>
  <message><source>Classifies LAS, LAZ or COPC point clouds of any source by the shape and colour around each point: ground, horizontal and vertical planes, lines, vegetation. Writes the classified cloud, and layers of planes (roofs, walls), lines (poles, wires, fences) and plants. Memory use does not depend on the size of the area.</source><translation>Klassifiziert LAS-, LAZ- oder COPC-Punktwolken beliebiger Herkunft nach Form und Farbe um jeden Punkt: Boden, waagerechte und senkrechte Flächen, Linien, Vegetation. Schreibt die klassifizierte Punktwolke und Ebenen mit Flächen (Dächer, Wände), Linien (Masten, Drähte, Zäune) und Pflanzen. Der Speicherbedarf hängt nicht von der Größe des Gebiets ab.</translation></message>
  <message><source>Clean point cloud</source><translation>Punktwolke bereinigen</translation></message>
  <message><source>Clean point clouds</source><translation>Punktwolken bereinigen</translation></message>
  <message><source>Colour a point cloud by images</source><translation>Eine Punktwolke mit Bildern färben</translation></message>
  <message><source>Coloured point cloud</source><translation>Gefärbte Punktwolke</translation></message>
  <message><source>Column of a covariate</source><translation>Spalte einer Kovariablen</translation></message>
  <message><source>Column of a covariate, such as the yield of the year before.</source><translation>Spalte einer Kovariablen, etwa der Ertrag des Vorjahrs.</translation></message>
  <message><source>Column of the dose</source><translation>Spalte der Aufwandmenge</translation></message>
  <message><source>Column of the dose [default: the first with a name such as n_kg_ha].</source><translation>Spalte der Aufwandmenge [Vorgabe: die erste mit einem Namen wie n_kg_ha].</translation></message>
  <message><source>Column of the measure</source><translation>Spalte der Messgröße</translation></message>
  <message><source>Column of the response [default: mean_height_m].</source><translation>Spalte der Wirkung [Vorgabe: mean_height_m].</translation></message>
  <message><source>Columns</source><translation>Spalten</translation></message>
  <message><source>Columns of other factors</source><translation>Spalten weiterer Faktoren</translation></message>
  <message><source>Columns of sites and years</source><translation>Spalten von Orten und Jahren</translation></message>
  <message><source>Combines the surfaces of a farm map's sessions into one raster. Where they overlap, the latest session is used. A .vrt is a small file that refers to the surfaces; a .tif is a cloud-optimised GeoTIFF with all bands.</source><translation>Fasst die Oberflächen der Sitzungen einer Betriebskarte in einem Raster zusammen. Wo sie sich überlappen, gilt die letzte Sitzung. Eine .vrt ist eine kleine Datei, die auf die Oberflächen verweist; eine .tif ist ein Cloud-optimiertes GeoTIFF mit allen Kanälen.</translation></message>
  <message><source>Compare points by their names, on each axis; CLOUD_OR_DSM may be a CSV of measured points.</source><translation>Punkte nach ihren Namen auf jeder Achse vergleichen; CLOUD_OR_DSM kann eine CSV-Datei gemessener Punkte sein.</translation></message>
  <message><source>Compares a point cloud or a surface with surveyed points. The RMSE follows the ASPRS Positional Accuracy Standards, Edition 2 (2023), and includes the accuracy of the points.</source><translation>Vergleicht eine Punktwolke oder eine Oberfläche mit eingemessenen Punkten. Der RMSE folgt den ASPRS Positional Accuracy Standards, Edition 2 (2023), und enthält die Genauigkeit der Punkte.</translation></message>
  <message><source>Compares six shapes of the response to a dose, finds the dose that pays and the one beyond which nothing is gained, analyses the variance by treatment, factors and block, and computes growth from tables of several days. Writes charts, a table and response.json.</source><translation>Vergleicht sechs Formen der Wirkung einer Aufwandmenge, findet die lohnende Menge und die, ab der nichts mehr gewonnen wird, rechnet die Varianzanalyse nach Variante, Faktoren und Block und berechnet den Zuwachs aus Tabellen mehrerer Tage. Schreibt Diagramme, eine Tabelle und response.json.</translation></message>
  <message><source>Compares the positions of GNSS logs with a reference at the same epochs: mean, standard deviation and RMSE in 3D, 2D, X, Y and Z, for all epochs and by fix type. Several services are compared in one table, and their tracks and errors become layers.</source><translation>Vergleicht die Positionen von GNSS-Logs zu gleichen Epochen mit einer Referenz: Mittel, Standardabweichung und RMSE in 3D, 2D, X, Y und Z, für alle Epochen und nach Art der Lösung. Mehrere Dienste werden in einer Tabelle verglichen, und ihre Spuren und Fehler werden Ebenen.</translation></message>
  <message><source>Compute the published method, too</source><translation>Auch das veröffentlichte Verfahren rechnen</translation></message>
  <message><source>Computes rasters from LAS, LAZ or COPC point clouds of any source: surface model (DSM), terrain model (DTM), height above ground, hillshade, slope, roughness, and low spots that hold water. Memory use does not depend on the size of the area.</source><translation>Berechnet Raster aus LAS-, LAZ- oder COPC-Punktwolken beliebiger Herkunft: Oberflächenmodell (DSM), Geländemodell (DTM), Höhe über dem Boden, Schummerung, Neigung, Rauheit und Senken, in denen Wasser steht. Der Speicherbedarf hängt nicht von der Größe des Gebiets ab.</translation></message>
  <message><source>Computes the attitude of a mount that moves against the vehicle, such as one on dampers, from images of a chessboard: the camera is on the mount and the board on the vehicle, or the other way round. A session names the table under [mount] attitude.</source><translation>Berechnet die Lage einer gegen das Fahrzeug bewegten Halterung, etwa auf Dämpfern, aus Bildern eines Schachbretts: Die Kamera sitzt auf der Halterung und die Tafel am Fahrzeug oder umgekehrt. Eine Sitzung nennt die Tabelle unter [mount] attitude.</translation></message>
  <message><source>Computes the georeferenced point cloud of a session's recording, detects in the scans when the implement is in the ground, and writes the worked ground, surfaces and a report.</source><translation>Berechnet die georeferenzierte Punktwolke der Aufzeichnung einer Sitzung, erkennt in den Scans, wann das Gerät im Boden ist, und schreibt den bearbeiteten Boden, Oberflächen und einen Bericht.</translation></message>
  <message><source>Computes the ground that a machine worked in each field from its ISO 11783-10 task data, without a scanner: passes, overlaps, missed strips and their areas.</source><translation>Berechnet aus Auftragsdaten nach ISO 11783-10, ohne Scanner, den Boden, den eine Maschine auf jedem Feld bearbeitete: Überfahrten, Überlappungen, ausgelassene Streifen und ihre Flächen.</translation></message>
  <message><source>Computes the positions of a rover relative to a base station from RINEX files, with RTKLIB's program rnx2rtkp, which you install yourself. To use the result, name it in a session as its GNSS log.</source><translation>Berechnet die Positionen eines Rovers gegenüber einer Basisstation aus RINEX-Dateien mit dem Programm rnx2rtkp von RTKLIB, das Sie selbst installieren. Um das Ergebnis zu verwenden, es in einer Sitzung als GNSS-Log nennen.</translation></message>
  <message><source>Content</source><translation>Inhalt</translation></message>
  <message><source>Continue an interrupted run into DIR. Its scan matching is reused if session and recordings have not changed.</source><translation>Eine unterbrochene Auswertung in DIR fortsetzen. Ihre Scanzuordnung wird wiederverwendet, wenn sich Sitzung und Aufzeichnungen nicht geändert haben.</translation></message>
  <message><source>Converts the results of a run: GeoPackage, GeoParquet, FlatGeobuf, GeoJSON, Shapefile, KML, CSV, ISO 11783-10 task data for farm software and terminals, or a STAC catalogue of many runs. GeoJSON and KML are always in WGS 84.</source><translation>Wandelt die Ergebnisse einer Auswertung um: GeoPackage, GeoParquet, FlatGeobuf, GeoJSON, Shapefile, KML, CSV, Auftragsdaten nach ISO 11783-10 für Büro-Software und Terminals oder ein STAC-Katalog vieler Auswertungen. GeoJSON und KML sind immer in WGS 84.</translation></message>
  <message><source>Coordinate transformations of a session</source><translation>Koordinatentransformationen einer Sitzung</translation></message>
  <message><source>Copy the sensor positions of this machine: the name of a saved one, or its profile.</source><translation>Die Sensorlagen dieser Maschine übernehmen: der Name einer gespeicherten oder ihr Profil.</translation></message>
  <message><source>Counts how often each spot was worked, when last, and how often rear wheels passed it, from the sessions of a farm map. To count wheel passes, state both widths.</source><translation>Zählt, wie oft jede Stelle bearbeitet wurde, wann zuletzt und wie oft Hinterräder darüberfuhren, aus den Sitzungen einer Betriebskarte. Für Radüberfahrten beide Breiten angeben.</translation></message>
  <message><source>Create a session file</source><translation>Eine Sitzungsdatei anlegen</translation></message>
  <message><source>Crop height</source><translation>Bestandeshöhe</translation></message>
  <message><source>Crops and trials</source><translation>Bestände und Versuche</translation></message>
  <message><source>Crops by parcel</source><translation>Bestand nach Parzellen</translation></message>
  <message><source>Crops of {name}</source><translation>Bestand von {name}</translation></message>
  <message><source>Data exchange</source><translation>Datenaustausch</translation></message>
  <message><source>Date of the first position</source><translation>Datum der ersten Position</translation></message>
  <message><source>Day of the flight</source><translation>Tag des Flugs</translation></message>
  <message><source>Day up to which doses are summed [default: that of the points].</source><translation>Tag, bis zu dem Mengen summiert werden [Vorgabe: der der Punkte].</translation></message>
  <message><source>Days of the flights</source><translation>Tage der Flüge</translation></message>
  <message><source>Describe square cells with sides of this length.</source><translation>Quadratische Zellen mit dieser Seitenlänge beschreiben.</translation></message>
  <message><source>Describe these polygons instead of cells.</source><translation>Diese Polygone statt Zellen beschreiben.</translation></message>
  <message><source>Describes trees, orchards and other stands in LAS, LAZ or COPC point clouds: canopy height model, height percentiles, gap fraction and vertical profile, by square cell or by polygon.</source><translation>Beschreibt Bäume, Obstanlagen und andere Bestände in LAS-, LAZ- oder COPC-Punktwolken: Bestandeshöhenmodell, Höhenperzentile, Lückenanteil und Vertikalprofil, je quadratischer Zelle oder Polygon.</translation></message>
  <message><source>Detect targets at the points by intensity or colour, for the horizontal error.</source><translation>Ziele an den Punkten nach Intensität oder Farbe erkennen, für den horizontalen Fehler.</translation></message>
  <message><source>Diameter of discs, side of checkerboards.</source><translation>Durchmesser der Scheiben, Seite der Schachbretter.</translation></message>
  <message><source>Diameter or side of the targets</source><translation>Durchmesser oder Seite der Ziele</translation></message>
  <message><source>Direction of the first row, clockwise from north, instead of its end.</source><translation>Richtung der ersten Reihe, im Uhrzeigersinn von Nord, statt ihres Endes.</translation></message>
  <message><source>Direction of tillage</source><translation>Richtung der Bodenbearbeitung</translation></message>
  <message><source>Direction of tillage, clockwise from grid north; removes tillage marks from the random roughness.</source><translation>Richtung der Bodenbearbeitung, im Uhrzeigersinn von Gitternord; entfernt Bearbeitungsspuren aus der Zufallsrauheit.</translation></message>
  <message><source>Distance between columns.</source><translation>Abstand zwischen den Spalten.</translation></message>
  <message><source>Distance between rows.</source><translation>Abstand zwischen den Reihen.</translation></message>
  <message><source>Draw the frames from the side and from above.</source><translation>Die Systeme von der Seite und von oben zeichnen.</translation></message>
  <message><source>Drawing</source><translation>Zeichnung</translation></message>
  <message><source>Elevation mask</source><translation>Elevationsmaske</translation></message>
  <message><source>End of the first row</source><translation>Ende der ersten Reihe</translation></message>
  <message><source>Ephemerides (RINEX)</source><translation>Ephemeriden (RINEX)</translation></message>
  <message><source>Epochs of the reference</source><translation>Epochen der Referenz</translation></message>
  <message><source>Estimates the scanner's mounting and the offset between its clock and the GNSS receiver's from the recording: on average the ground is level, and ground scanned twice coincides.</source><translation>Schätzt den Einbau des Scanners und den Versatz zwischen seiner Uhr und der des GNSS-Empfängers aus der Aufzeichnung: Im Mittel ist der Boden eben, und doppelt abgetasteter Boden stimmt überein.</translation></message>
  <message><source>Evaluate GNSS logs</source><translation>GNSS-Logs bewerten</translation></message>
  <message><source>Evaluation (HTML)</source><translation>Bewertung (HTML)</translation></message>
  <message><source>Every n-th point</source><translation>Jeder n-te Punkt</translation></message>
  <message><source>Example on the command line</source><translation>Beispiel auf der Kommandozeile</translation></message>
  <message><source>Exit with status 4 if the results contradict each other. They are written nevertheless.</source><translation>Mit Status 4 enden, wenn die Ergebnisse einander widersprechen. Geschrieben werden sie trotzdem.</translation></message>
  <message><source>Export results</source><translation>Ergebnisse exportieren</translation></message>
  <message><source>Extent</source><translation>Ausschnitt</translation></message>
  <message><source>Farm map</source><translation>Betriebskarte</translation></message>
  <message><source>Farm map (GeoPackage)</source><translation>Betriebskarte (GeoPackage)</translation></message>
  <message><source>Farm map (PostGIS)</source><translation>Betriebskarte (PostGIS)</translation></message>
  <message><source>Features (GeoPackage)</source><translation>Merkmale (GeoPackage)</translation></message>
  <message><source>Features of point clouds</source><translation>Merkmale von Punktwolken</translation></message>
  <message><source>Features of {name}</source><translation>Merkmale von {name}</translation></message>
  <message><source>Field</source><translation>Feld</translation></message>
  <message><source>Field, drive and sensors. By default a small field that is tilled for a minute.</source><translation>Feld, Fahrt und Sensoren. Vorgabe: ein kleines Feld, das eine Minute lang bearbeitet wird.</translation></message>
  <message><source>Fields (JSON)</source><translation>Felder (JSON)</translation></message>
  <message><source>Fields, seasons and machines of the farm map</source><translation>Felder, Saisons und Maschinen der Betriebskarte</translation></message>
  <message><source>Figures by field (JSON)</source><translation>Kennzahlen nach Feld (JSON)</translation></message>
  <message><source>File or folder written</source><translation>Geschriebene Datei oder Ordner</translation></message>
  <message><source>File to open</source><translation>Zu öffnende Datei</translation></message>
  <message><source>File to write [default: name of ROVER with .pos].</source><translation>Zu schreibende Datei [Vorgabe: Name von ROVER mit .pos].</translation></message>
  <message><source>Files written</source><translation>Geschriebene Dateien</translation></message>
  <message><source>Fill gaps up to this distance from the nearest measured height, but not beyond the outline of the data.</source><translation>Lücken bis zu dieser Entfernung von der nächsten gemessenen Höhe füllen, aber nicht über den Umriss der Daten hinaus.</translation></message>
  <message><source>Findings (JSON)</source><translation>Befunde (JSON)</translation></message>
  <message><source>First corner</source><translation>Erste Ecke</translation></message>
  <message><source>First day</source><translation>Erster Tag</translation></message>
  <message><source>First day of a season (MM-DD)</source><translation>Erster Tag einer Saison (MM-TT)</translation></message>
  <message><source>First day of a season, such as 04-01; kept in MAP [default: 01-01].</source><translation>Erster Tag einer Saison, etwa 04-01; in MAP gespeichert [Vorgabe: 01-01].</translation></message>
  <message><source>First number</source><translation>Erste Nummer</translation></message>
  <message><source>Folder for evaluation.json, evaluation.html, evaluation.gpkg, services.csv and epochs.csv.</source><translation>Ordner für evaluation.json, evaluation.html, evaluation.gpkg, services.csv und epochs.csv.</translation></message>
  <message><source>Folder of the season.</source><translation>Ordner der Saison.</translation></message>
  <message><source>Format</source><translation>Format</translation></message>
  <message><source>Forward,left,up: from the antenna of the reference to that of the log, on the same vehicle. One line for all logs, or one for each.</source><translation>Vorn,links,oben: von der Antenne der Referenz zu der des Logs, auf demselben Fahrzeug. Eine Zeile für alle Logs oder eine je Log.</translation></message>
  <message><source>Found in the recordings</source><translation>In den Aufzeichnungen gefunden</translation></message>
  <message><source>Frames of a session</source><translation>Bezugssysteme einer Sitzung</translation></message>
  <message><source>GeoPackage, Shapefile, GeoJSON, FlatGeobuf, KML, or a CSV of corners, in any CRS.</source><translation>GeoPackage, Shapefile, GeoJSON, FlatGeobuf, KML oder eine CSV-Datei mit Ecken, in beliebigem KBS.</translation></message>
  <message><source>Give either '{one}' or '{other}'.</source><translation>Entweder „{one}“ oder „{other}“ angeben.</translation></message>
  <message><source>Gross parcels: GeoPackage, Shapefile, GeoJSON, FlatGeobuf, KML, or a CSV of corners.</source><translation>Bruttoparzellen: GeoPackage, Shapefile, GeoJSON, FlatGeobuf, KML oder eine CSV-Datei mit Ecken.</translation></message>
  <message><source>Ground classification</source><translation>Bodenklassifikation</translation></message>
  <message><source>Ground classification method: ground becomes class 2, the rest class 1, except noise and the machine in furrowmap's own clouds. none keeps the classes.</source><translation>Verfahren der Bodenklassifikation: Boden wird Klasse 2, der Rest Klasse 1, außer Rauschen und der Maschine in furrowmaps eigenen Punktwolken. none behält die Klassen.</translation></message>
  <message><source>Ground classification method; auto uses the ground class of the input if there is one, else smrf.</source><translation>Verfahren der Bodenklassifikation; auto verwendet die Bodenklasse der Eingabe, falls vorhanden, sonst smrf.</translation></message>
  <message><source>Growth</source><translation>Zuwachs</translation></message>
  <message><source>Growth of crops by parcel</source><translation>Zuwachs des Bestands nach Parzellen</translation></message>
  <message><source>Height of a layer of the profile</source><translation>Höhe einer Schicht des Profils</translation></message>
  <message><source>Height of a layer of the profile.</source><translation>Höhe einer Schicht des Profils.</translation></message>
  <message><source>Height statistic per cell: median, trimmed, mean, min, max, or a percentile such as p90.</source><translation>Höhenstatistik je Zelle: median, trimmed, mean, min, max oder ein Perzentil wie p90.</translation></message>
  <message><source>Highest return from the ground</source><translation>Höchstes Echo vom Boden</translation></message>
  <message><source>History of a field</source><translation>Historie eines Felds</translation></message>
  <message><source>Images</source><translation>Bilder</translation></message>
  <message><source>Images with the board</source><translation>Bilder mit der Tafel</translation></message>
  <message><source>Inner corners of the chessboard</source><translation>Innere Ecken des Schachbretts</translation></message>
  <message><source>Inner corners of the chessboard, such as 9x6.</source><translation>Innere Ecken des Schachbretts, etwa 9x6.</translation></message>
  <message><source>Inputs</source><translation>Eingaben</translation></message>
  <message><source>Inspect recordings</source><translation>Aufzeichnungen untersuchen</translation></message>
  <message><source>Its [camera] has the intrinsics. Without it they are estimated from the images.</source><translation>Ihr [camera] enthält die inneren Parameter. Ohne sie werden sie aus den Bildern geschätzt.</translation></message>
  <message><source>Its [camera] names the images; GNSS and IMU give their poses. The scans are not read.</source><translation>Ihr [camera] nennt die Bilder; GNSS und IMU liefern deren Posen. Die Scans werden nicht gelesen.</translation></message>
  <message><source>Its name or identifier; the list has the fields of the farm map.</source><translation>Sein Name oder seine Kennung; die Liste hat die Felder der Betriebskarte.</translation></message>
  <message><source>Keep every N-th point.</source><translation>Jeden N-ten Punkt behalten.</translation></message>
  <message><source>Keep points in this box, in the CRS of the output.</source><translation>Punkte in diesem Ausschnitt behalten, im KBS der Ausgabe.</translation></message>
  <message><source>Keep points of these classes [default: all but noise and, in furrowmap's own clouds, the machine].</source><translation>Punkte dieser Klassen behalten [Vorgabe: alle außer Rauschen und, in furrowmaps eigenen Punktwolken, der Maschine].</translation></message>
  <message><source>Known point</source><translation>Bekannter Punkt</translation></message>
  <message><source>LAS, LAZ or COPC file.</source><translation>LAS-, LAZ- oder COPC-Datei.</translation></message>
  <message><source>LAS, LAZ or COPC files in one CRS.</source><translation>LAS-, LAZ- oder COPC-Dateien in einem KBS.</translation></message>
  <message><source>LAS, LAZ or COPC files of two days or more.</source><translation>LAS-, LAZ- oder COPC-Dateien von zwei oder mehr Tagen.</translation></message>
  <message><source>LAS, LAZ or COPC files, used together.</source><translation>LAS-, LAZ- oder COPC-Dateien, gemeinsam verwendet.</translation></message>
  <message><source>LAS, LAZ or COPC files; all go into one raster grid.</source><translation>LAS-, LAZ- oder COPC-Dateien; alle gehen in ein Raster ein.</translation></message>
  <message><source>LAS, LAZ, COPC or GeoTIFF.</source><translation>LAS, LAZ, COPC oder GeoTIFF.</translation></message>
  <message><source>Last day</source><translation>Letzter Tag</translation></message>
  <message><source>Latitude, longitude and height above the ellipsoid of its antenna, separated by commas; by default approximate, from its file.</source><translation>Breite, Länge und Höhe ihrer Antenne über dem Ellipsoid, durch Komma getrennt; Vorgabe: genähert, aus ihrer Datei.</translation></message>
  <message><source>Lay out the plots of a trial</source><translation>Die Parzellen eines Versuchs anlegen</translation></message>
  <message><source>Layers</source><translation>Ebenen</translation></message>
  <message><source>Leave out noise</source><translation>Rauschen auslassen</translation></message>
  <message><source>Leave out outliers and the noise classes 7 and 18 of the input.</source><translation>Ausreißer und die Rauschklassen 7 und 18 der Eingabe auslassen.</translation></message>
  <message><source>Leave out satellites below this elevation.</source><translation>Satelliten unter dieser Elevation auslassen.</translation></message>
  <message><source>Leave out the effects of blocks</source><translation>Die Blockeffekte weglassen</translation></message>
  <message><source>Leave out the effects of blocks.</source><translation>Die Blockeffekte weglassen.</translation></message>
  <message><source>Leave out these classes; 64,65 are the machine in furrowmap's own clouds.</source><translation>Diese Klassen auslassen; 64,65 sind die Maschine in furrowmaps eigenen Punktwolken.</translation></message>
  <message><source>Length of a plot</source><translation>Länge einer Parzelle</translation></message>
  <message><source>Length of a plot along the base line [default: from the two corners].</source><translation>Länge einer Parzelle entlang der Grundlinie [Vorgabe: aus den beiden Ecken].</translation></message>
  <message><source>LiDAR captures or bags, GNSS logs and trajectories of one drive.</source><translation>LiDAR-Aufzeichnungen oder Bags, GNSS-Logs und Trajektorien einer Fahrt.</translation></message>
  <message><source>List the saved machines</source><translation>Die gespeicherten Maschinen auflisten</translation></message>
  <message><source>List the sessions of the farm map</source><translation>Die Sitzungen der Betriebskarte auflisten</translation></message>
  <message><source>Lists the saved machines.</source><translation>Listet die gespeicherten Maschinen auf.</translation></message>
  <message><source>Lists the sessions of a farm map: identifier, date, worked area, name.</source><translation>Listet die Sitzungen einer Betriebskarte auf: Kennung, Datum, bearbeitete Fläche, Name.</translation></message>
  <message><source>Lists the work of each field and season in a farm map, and that of each machine.</source><translation>Listet die Arbeit jedes Felds und jeder Saison einer Betriebskarte auf, und die jeder Maschine.</translation></message>
  <message><source>Logs to evaluate</source><translation>Zu bewertende Logs</translation></message>
  <message><source>Machine</source><translation>Maschine</translation></message>
  <message><source>Machines (JSON)</source><translation>Maschinen (JSON)</translation></message>
  <message><source>Makes the plots of a trial as a grid of rectangles with identifiers and blocks. Click the outer corner of the first plot, and the other end of the first row.</source><translation>Legt die Parzellen eines Versuchs als Raster von Rechtecken mit Kennungen und Blöcken an. Die äußere Ecke der ersten Parzelle und das andere Ende der ersten Reihe anklicken.</translation></message>
  <message><source>Maximum gap to fill</source><translation>Größte zu füllende Lücke</translation></message>
  <message><source>Maximum interpolation gap</source><translation>Größte Interpolationslücke</translation></message>
  <message><source>Maximum interpolation gap of the reference [default: 1.5 times its interval].</source><translation>Größte Interpolationslücke der Referenz [Vorgabe: das 1,5-Fache ihres Abstands].</translation></message>
  <message><source>Maximum number of rows of a Parquet file.</source><translation>Höchste Zeilenzahl einer Parquet-Datei.</translation></message>
  <message><source>Mean of all sessions</source><translation>Mittel aller Sitzungen</translation></message>
  <message><source>Measures height and volume of the crop on each parcel from LAS, LAZ or COPC point clouds of any source, with standard deviations: a layer of the parcels, a table, and a raster of crop heights.</source><translation>Misst Höhe und Volumen des Bestands jeder Parzelle aus LAS-, LAZ- oder COPC-Punktwolken beliebiger Herkunft, mit Standardabweichungen: eine Ebene der Parzellen, eine Tabelle und ein Raster der Bestandeshöhen.</translation></message>
  <message><source>Measures how much the crop on each parcel grew between flights of several days, aligned in height by the bare soil that they have in common, with standard deviations: a layer coloured by growth, and a table.</source><translation>Misst, um wie viel der Bestand jeder Parzelle zwischen Flügen mehrerer Tage wuchs, in der Höhe am gemeinsamen unbewachsenen Boden ausgerichtet, mit Standardabweichungen: eine nach Zuwachs gefärbte Ebene und eine Tabelle.</translation></message>
  <message><source>Merges the results of many sessions, such as those of a list of drives: for each date a mosaic of the surfaces, of the change and of the worked ground, tables of points and trajectories, and a STAC catalogue. Unchanged parts are not computed again.</source><translation>Führt die Ergebnisse vieler Sitzungen zusammen, etwa die einer Liste von Fahrten: je Zeitpunkt ein Mosaik der Oberflächen, der Änderung und des bearbeiteten Bodens, Tabellen der Punkte und Trajektorien und ein STAC-Katalog. Unveränderte Teile werden nicht neu berechnet.</translation></message>
  <message><source>Method for heights and volumes</source><translation>Verfahren für Höhen und Volumen</translation></message>
  <message><source>Method for heights and volumes: the canopy's top, unbiased by point density, or as published in 2017.</source><translation>Verfahren für Höhen und Volumen: die Bestandesoberkante, unabhängig von der Punktdichte, oder wie 2017 veröffentlicht.</translation></message>
  <message><source>Metres to cut off each end and off each side of the gross parcels [default: none].</source><translation>Meter, die an jedem Ende und an jeder Seite der Bruttoparzellen abgeschnitten werden [Vorgabe: keine].</translation></message>
  <message><source>Missing from the recordings</source><translation>In den Aufzeichnungen nicht enthalten</translation></message>
  <message><source>Mosaic</source><translation>Mosaik</translation></message>
  <message><source>Mosaic of the farm map's surfaces</source><translation>Mosaik der Oberflächen der Betriebskarte</translation></message>
  <message><source>Most rows</source><translation>Höchste Zeilenzahl</translation></message>
  <message><source>NMEA, or other logs that 'Inspect recordings' reads.</source><translation>NMEA oder andere Logs, die „Aufzeichnungen untersuchen“ liest.</translation></message>
  <message><source>Names</source><translation>Namen</translation></message>
  <message><source>Navigation files of the same day.</source><translation>Navigationsdateien desselben Tags.</translation></message>
  <message><source>Net parcels from a file</source><translation>Nettoparzellen aus einer Datei</translation></message>
  <message><source>Net parcels with the same identifiers, instead of an inset.</source><translation>Nettoparzellen mit denselben Kennungen statt eines Abzugs.</translation></message>
  <message><source>Net parcels: metres off each end, off each side</source><translation>Nettoparzellen: Meter an jedem Ende, an jeder Seite</translation></message>
  <message><source>Number each block anew</source><translation>Jeden Block neu nummerieren</translation></message>
  <message><source>Number of areas</source><translation>Anzahl der Flächen</translation></message>
  <message><source>Number of changes</source><translation>Anzahl der Änderungen</translation></message>
  <message><source>Number of parcels</source><translation>Anzahl der Parzellen</translation></message>
  <message><source>Number of passes</source><translation>Anzahl der Überfahrten</translation></message>
  <message><source>Number of plots across the base line.</source><translation>Anzahl der Parzellen quer zur Grundlinie.</translation></message>
  <message><source>Number of plots along the base line.</source><translation>Anzahl der Parzellen entlang der Grundlinie.</translation></message>
  <message><source>Number of points</source><translation>Anzahl der Punkte</translation></message>
  <message><source>Number of rows or columns in a block.</source><translation>Anzahl der Reihen oder Spalten in einem Block.</translation></message>
  <message><source>Number of sessions</source><translation>Anzahl der Sitzungen</translation></message>
  <message><source>Number of sessions left</source><translation>Anzahl der verbleibenden Sitzungen</translation></message>
  <message><source>Number of sessions removed</source><translation>Anzahl der entfernten Sitzungen</translation></message>
  <message><source>Number of surfaces</source><translation>Anzahl der Oberflächen</translation></message>
  <message><source>Number of the first plot.</source><translation>Nummer der ersten Parzelle.</translation></message>
  <message><source>Number of threads [default: FURROWMAP_THREADS, else the number of processors, at most 8].</source><translation>Anzahl der Threads [Vorgabe: FURROWMAP_THREADS, sonst die Anzahl der Prozessoren, höchstens 8].</translation></message>
  <message><source>Number of worker processes [default: by cores and memory].</source><translation>Anzahl der Arbeitsprozesse [Vorgabe: nach Kernen und Speicher].</translation></message>
  <message><source>Numbering</source><translation>Nummerierung</translation></message>
  <message><source>Numbers along</source><translation>Nummern entlang</translation></message>
  <message><source>Observations of the base station at the same time.</source><translation>Beobachtungen der Basisstation zur selben Zeit.</translation></message>
  <message><source>Observations of the rover.</source><translation>Beobachtungen des Rovers.</translation></message>
  <message><source>Of a rear tyre, in metres.</source><translation>Eines Hinterreifens, in Metern.</translation></message>
  <message><source>Of a static antenna, instead of a log: latitude, longitude, height, separated by commas.</source><translation>Einer ruhenden Antenne statt eines Logs: Breite, Länge, Höhe, durch Komma getrennt.</translation></message>
  <message><source>Of the services in the tables: one per line, in the order of the logs.</source><translation>Der Dienste in den Tabellen: einer je Zeile, in der Reihenfolge der Logs.</translation></message>
  <message><source>One column per line, beside the dose.</source><translation>Eine Spalte je Zeile, neben der Aufwandmenge.</translation></message>
  <message><source>One column per line, such as location and year.</source><translation>Eine Spalte je Zeile, etwa Ort und Jahr.</translation></message>
  <message><source>One per line, in the order of the clouds: 2017-05-23.</source><translation>Eine je Zeile, in der Reihenfolge der Punktwolken: 2017-05-23.</translation></message>
  <message><source>One per line, in the order of the tables: 2017-05-23.</source><translation>Eine je Zeile, in der Reihenfolge der Tabellen: 2017-05-23.</translation></message>
  <message><source>One per line: the identifier, the beginning of it, or the name.</source><translation>Eine je Zeile: die Kennung, deren Anfang oder der Name.</translation></message>
  <message><source>Only sessions from this day on.</source><translation>Nur Sitzungen ab diesem Tag.</translation></message>
  <message><source>Only sessions up to this day.</source><translation>Nur Sitzungen bis zu diesem Tag.</translation></message>
  <message><source>Only the ground in them is mapped: GeoPackage, Shapefile, GeoJSON, FlatGeobuf, KML, or task data.</source><translation>Nur der Boden darin wird kartiert: GeoPackage, Shapefile, GeoJSON, FlatGeobuf, KML oder Auftragsdaten.</translation></message>
  <message><source>Open the products as styled layers</source><translation>Die Produkte als Ebenen mit Stilen öffnen</translation></message>
  <message><source>Other end of the base line: the outer corner of the first row's last plot.</source><translation>Anderes Ende der Grundlinie: die äußere Ecke der letzten Parzelle der ersten Reihe.</translation></message>
  <message><source>Otherwise the algorithm stops if the output exists.</source><translation>Sonst hält der Algorithmus an, wenn die Ausgabe existiert.</translation></message>
  <message><source>Outer corner of the first plot, where the base line begins.</source><translation>Äußere Ecke der ersten Parzelle, an der die Grundlinie beginnt.</translation></message>
  <message><source>Outlier detection method</source><translation>Verfahren der Ausreißererkennung</translation></message>
  <message><source>Outlier detection method; outliers are left out.</source><translation>Verfahren der Ausreißererkennung; Ausreißer werden ausgelassen.</translation></message>
  <message><source>Outlier detection method; outliers become noise (class 7).</source><translation>Verfahren der Ausreißererkennung; Ausreißer werden Rauschen (Klasse 7).</translation></message>
  <message><source>Output file or folder</source><translation>Ausgabedatei oder -ordner</translation></message>
  <message><source>Output file.</source><translation>Ausgabedatei.</translation></message>
  <message><source>Output folder</source><translation>Ausgabeordner</translation></message>
  <message><source>Output folder [default: beside RESULT].</source><translation>Ausgabeordner [Vorgabe: neben RESULT].</translation></message>
  <message><source>Output folder.</source><translation>Ausgabeordner.</translation></message>
  <message><source>Output raster (.tif).</source><translation>Ausgaberaster (.tif).</translation></message>
  <message><source>Output raster: .vrt or .tif.</source><translation>Ausgaberaster: .vrt oder .tif.</translation></message>
  <message><source>Output: .html for a page, .csv for a table.</source><translation>Ausgabe: .html für eine Seite, .csv für eine Tabelle.</translation></message>
  <message><source>Outputs</source><translation>Ausgaben</translation></message>
  <message><source>Overwrite existing files</source><translation>Vorhandene Dateien überschreiben</translation></message>
  <message><source>Page or table</source><translation>Seite oder Tabelle</translation></message>
  <message><source>Pairs</source><translation>Paare</translation></message>
  <message><source>Parcels</source><translation>Parzellen</translation></message>
  <message><source>Path</source><translation>Weg</translation></message>
  <message><source>Pixel of the canopy height model</source><translation>Pixel des Bestandeshöhenmodells</translation></message>
  <message><source>Pixel of the canopy height model [default: the smallest round size with four points, up to 1 m].</source><translation>Pixel des Bestandeshöhenmodells [Vorgabe: die kleinste runde Größe mit vier Punkten, bis 1 m].</translation></message>
  <message><source>Plots</source><translation>Parzellenplan</translation></message>
  <message><source>Plots, as .gpkg or .geojson.</source><translation>Parzellen, als .gpkg oder .geojson.</translation></message>
  <message><source>Point cloud</source><translation>Punktwolke</translation></message>
  <message><source>Point cloud or surface</source><translation>Punktwolke oder Oberfläche</translation></message>
  <message><source>Point clouds</source><translation>Punktwolken</translation></message>
  <message><source>Point spacing</source><translation>Punktabstand</translation></message>
  <message><source>Points and trajectories are GeoParquet, which needs the extra 'parquet'.</source><translation>Punkte und Trajektorien sind GeoParquet, das das Zusatzpaket „parquet“ braucht.</translation></message>
  <message><source>Polygons instead of cells</source><translation>Polygone statt Zellen</translation></message>
  <message><source>Position of the base station</source><translation>Position der Basisstation</translation></message>
  <message><source>Position of the board; the camera is on the other part.</source><translation>Position der Tafel; die Kamera sitzt am anderen Teil.</translation></message>
  <message><source>Positions</source><translation>Positionen</translation></message>
  <message><source>Positions from RINEX files</source><translation>Positionen aus RINEX-Dateien</translation></message>
  <message><source>PostGIS schema</source><translation>PostGIS-Schema</translation></message>
  <message><source>PostGIS schema of the tables.</source><translation>PostGIS-Schema der Tabellen.</translation></message>
  <message><source>Preview only</source><translation>Nur Vorschau</translation></message>
  <message><source>Price of a unit of the dose</source><translation>Preis einer Einheit der Aufwandmenge</translation></message>
  <message><source>Price of a unit of the dose, such as a kilogram of nitrogen, for the economic optimum.</source><translation>Preis einer Einheit der Aufwandmenge, etwa eines Kilogramms Stickstoff, für das ökonomische Optimum.</translation></message>
  <message><source>Price of a unit of the measure</source><translation>Preis einer Einheit der Messgröße</translation></message>
  <message><source>Price of a unit of the measure, such as a tonne of grain per hectare.</source><translation>Preis einer Einheit der Messgröße, etwa einer Tonne Korn je Hektar.</translation></message>
  <message><source>Process only the task with this identifier or name.</source><translation>Nur den Auftrag mit dieser Kennung oder diesem Namen verarbeiten.</translation></message>
  <message><source>Products of a season</source><translation>Produkte einer Saison</translation></message>
  <message><source>Products of the same recording in it are replaced.</source><translation>Produkte derselben Aufzeichnung darin werden ersetzt.</translation></message>
  <message><source>Projected CRS of the plots, such as EPSG:25832.</source><translation>Projiziertes KBS der Parzellen, etwa EPSG:25832.</translation></message>
  <message><source>Projected CRS, such as EPSG:6677 [default: chosen from the location].</source><translation>Projiziertes KBS, etwa EPSG:25832 [Vorgabe: nach dem Ort gewählt].</translation></message>
  <message><source>Quick look within seconds: the track and a coarse surface from a few scans, without scan matching or implement detection. Replaces an earlier preview, never the products of a run.</source><translation>Schneller Blick in Sekunden: die Spur und eine grobe Oberfläche aus wenigen Scans, ohne Scanzuordnung und Geräteerkennung. Ersetzt eine frühere Vorschau, nie die Produkte einer Auswertung.</translation></message>
  <message><source>Ratio of these prices</source><translation>Verhältnis dieser Preise</translation></message>
  <message><source>Read the undamaged parts of damaged clouds.</source><translation>Die unbeschädigten Teile beschädigter Punktwolken lesen.</translation></message>
  <message><source>Reads recordings and writes a commented session.toml with everything that they contain. It lists what they do not contain, such as the mounting of the scanner, and leaves comments where you enter it.</source><translation>Liest Aufzeichnungen und schreibt eine kommentierte session.toml mit allem, was sie enthalten. Was sie nicht enthalten, etwa der Einbau des Scanners, wird aufgeführt; Kommentare zeigen, wo es einzutragen ist.</translation></message>
  <message><source>Recordings</source><translation>Aufzeichnungen</translation></message>
  <message><source>Reference log</source><translation>Referenzlog</translation></message>
  <message><source>Refuse sessions in another CRS</source><translation>Sitzungen in anderem KBS ablehnen</translation></message>
  <message><source>Refuse sessions in another CRS instead of transforming them.</source><translation>Sitzungen in anderem KBS ablehnen, statt sie zu transformieren.</translation></message>
  <message><source>Remove sessions from the farm map</source><translation>Sitzungen aus der Betriebskarte entfernen</translation></message>
  <message><source>Removes sessions from a farm map. The folders of their results are not touched.</source><translation>Entfernt Sitzungen aus einer Betriebskarte. Die Ergebnisordner bleiben unberührt.</translation></message>
  <message><source>Replace the products of another recording</source><translation>Produkte einer anderen Aufzeichnung ersetzen</translation></message>
  <message><source>Replace the products of another recording in DIR.</source><translation>Produkte einer anderen Aufzeichnung in DIR ersetzen.</translation></message>
  <message><source>Report (HTML)</source><translation>Bericht (HTML)</translation></message>
  <message><source>Reports how a run transforms the coordinates of a session, with figures for the site: reference frame and epoch, size of the shift, geoid height, grid convergence and scale factor. Writes no files.</source><translation>Zeigt, wie eine Auswertung die Koordinaten einer Sitzung transformiert, mit Werten für den Ort: Bezugsrahmen und Epoche, Größe der Verschiebung, Geoidhöhe, Meridiankonvergenz und Maßstabsfaktor. Schreibt keine Dateien.</translation></message>
  <message><source>Reports what recordings contain: sensor model, points, time span, clocks and their differences, fix types.</source><translation>Zeigt, was Aufzeichnungen enthalten: Sensormodell, Punkte, Zeitspanne, Uhren und ihre Differenzen, Arten der Lösung.</translation></message>
  <message><source>Required horizontal RMSE</source><translation>Geforderter horizontaler RMSE</translation></message>
  <message><source>Required vertical RMSE</source><translation>Geforderter vertikaler RMSE</translation></message>
  <message><source>Requirements met</source><translation>Anforderungen erfüllt</translation></message>
  <message><source>Restart the numbers in each block: 101, 102, … 201.</source><translation>Die Nummern in jedem Block neu beginnen: 101, 102, … 201.</translation></message>
  <message><source>Result of a run</source><translation>Ergebnis einer Auswertung</translation></message>
  <message><source>Results of runs</source><translation>Ergebnisse von Auswertungen</translation></message>
  <message><source>Resume</source><translation>Fortsetzen</translation></message>
  <message><source>Returns up to this height count as ground; in forests 2 is usual.</source><translation>Echos bis zu dieser Höhe zählen als Boden; im Wald sind 2 üblich.</translation></message>
  <message><source>Roll, pitch and yaw of the board</source><translation>Roll, Pitch und Gier der Tafel</translation></message>
  <message><source>Rover (RINEX)</source><translation>Rover (RINEX)</translation></message>
  <message><source>Rows</source><translation>Reihen</translation></message>
  <message><source>Rows or columns of a block</source><translation>Reihen oder Spalten eines Blocks</translation></message>
  <message><source>Run a session</source><translation>Eine Sitzung auswerten</translation></message>
  <message><source>Save the machine of a session</source><translation>Die Maschine einer Sitzung speichern</translation></message>
  <message><source>Saves the positions of antenna, scanner, IMU, camera and implement from a session, for other sessions of the same machine.</source><translation>Speichert die Lagen von Antenne, Scanner, IMU, Kamera und Gerät aus einer Sitzung, für andere Sitzungen derselben Maschine.</translation></message>
  <message><source>Scenario</source><translation>Szenario</translation></message>
  <message><source>Scheduler</source><translation>Scheduler</translation></message>
  <message><source>Season</source><translation>Saison</translation></message>
  <message><source>Seasons of fields (JSON)</source><translation>Saisons der Felder (JSON)</translation></message>
  <message><source>Session file</source><translation>Sitzungsdatei</translation></message>
  <message><source>Session file to write [default: session.toml beside RECORDING].</source><translation>Zu schreibende Sitzungsdatei [Vorgabe: session.toml neben RECORDING].</translation></message>
  <message><source>Session file written</source><translation>Geschriebene Sitzungsdatei</translation></message>
  <message><source>Session with the intrinsics</source><translation>Sitzung mit den inneren Parametern</translation></message>
  <message><source>Sessions</source><translation>Sitzungen</translation></message>
  <message><source>Sessions (JSON)</source><translation>Sitzungen (JSON)</translation></message>
  <message><source>Shape of the response</source><translation>Form der Wirkung</translation></message>
  <message><source>Shape of the response; auto compares all and averages over them by weight.</source><translation>Form der Wirkung; auto vergleicht alle und mittelt nach Gewicht.</translation></message>
  <message><source>Shape of the targets</source><translation>Form der Ziele</translation></message>
  <message><source>Shape of the targets that the points' file does not name in a column target.</source><translation>Form der Ziele, die die Punktdatei nicht in einer Spalte target nennt.</translation></message>
  <message><source>Share a result</source><translation>Ein Ergebnis teilen</translation></message>
  <message><source>Shows the frames of a session: earth, map, vehicle, and each sensor with its position, its angles and the directions of its axes in words, and draws them from the side and from above. Does not read the recordings.</source><translation>Zeigt die Bezugssysteme einer Sitzung: Erde, Karte, Fahrzeug und jeden Sensor mit Lage, Winkeln und den Richtungen seiner Achsen in Worten, und zeichnet sie von der Seite und von oben. Liest die Aufzeichnungen nicht.</translation></message>
  <message><source>Side</source><translation>Seite</translation></message>
  <message><source>Side of a square</source><translation>Seitenlänge eines Quadrats</translation></message>
  <message><source>Side of a square.</source><translation>Seitenlänge eines Quadrats.</translation></message>
  <message><source>Side of checkerboards</source><translation>Seite der Schachbretter</translation></message>
  <message><source>Side of checkerboards beside discs of another size [default: that of --diameter].</source><translation>Seite der Schachbretter neben Scheiben anderer Größe [Vorgabe: die von --diameter].</translation></message>
  <message><source>Side of the base line on which the rows lie, looking along it.</source><translation>Seite der Grundlinie, auf der die Reihen liegen, in ihrer Richtung gesehen.</translation></message>
  <message><source>Side of the cells</source><translation>Seitenlänge der Zellen</translation></message>
  <message><source>Simulate a recording</source><translation>Eine Aufzeichnung simulieren</translation></message>
  <message><source>Soil below the crop</source><translation>Boden unter dem Bestand</translation></message>
  <message><source>Soil of another date</source><translation>Boden eines anderen Zeitpunkts</translation></message>
  <message><source>Standard deviation of its heights</source><translation>Standardabweichung seiner Höhen</translation></message>
  <message><source>Standard deviation of the heights of the reference.</source><translation>Standardabweichung der Höhen der Referenz.</translation></message>
  <message><source>Standard deviation of the survey</source><translation>Standardabweichung der Vermessung</translation></message>
  <message><source>Standard deviation of the survey on each axis.</source><translation>Standardabweichung der Vermessung auf jeder Achse.</translation></message>
  <message><source>Stands by cell or polygon</source><translation>Bestände nach Zellen oder Polygonen</translation></message>
  <message><source>Strict</source><translation>Streng</translation></message>
  <message><source>Surface</source><translation>Oberfläche</translation></message>
  <message><source>Surfaces and point clouds</source><translation>Oberflächen und Punktwolken</translation></message>
  <message><source>Surfaces from point clouds</source><translation>Oberflächen aus Punktwolken</translation></message>
  <message><source>Surfaces of {name}</source><translation>Oberflächen von {name}</translation></message>
  <message><source>Surveyed points</source><translation>Eingemessene Punkte</translation></message>
  <message><source>Surveyed surface or points</source><translation>Eingemessene Oberfläche oder Punkte</translation></message>
  <message><source>TASKDATA.XML in its folder, or a .zip of the folder.</source><translation>TASKDATA.XML in ihrem Ordner oder eine .zip des Ordners.</translation></message>
  <message><source>Table of errors</source><translation>Tabelle der Fehler</translation></message>
  <message><source>Table of roll, pitch and yaw over time.</source><translation>Tabelle von Roll, Pitch und Gier über der Zeit.</translation></message>
  <message><source>Table of the areas</source><translation>Tabelle der Flächen</translation></message>
  <message><source>Table of the growth</source><translation>Tabelle des Zuwachses</translation></message>
  <message><source>Table of the parcels</source><translation>Tabelle der Parzellen</translation></message>
  <message><source>Table of the profiles</source><translation>Tabelle der Profile</translation></message>
  <message><source>Tables of parcels</source><translation>Tabellen der Parzellen</translation></message>
  <message><source>Targets</source><translation>Ziele</translation></message>
  <message><source>Task</source><translation>Auftrag</translation></message>
  <message><source>Task data</source><translation>Auftragsdaten</translation></message>
  <message><source>The board is on the</source><translation>Die Tafel sitzt</translation></message>
  <message><source>The dates are moved onto it: GeoTIFF, or CSV or GeoPackage of points.</source><translation>Die Zeitpunkte werden darauf bezogen: GeoTIFF, oder CSV oder GeoPackage mit Punkten.</translation></message>
  <message><source>The farm's GeoPackage.</source><translation>Das GeoPackage des Betriebs.</translation></message>
  <message><source>The first price over the second, instead of both.</source><translation>Der erste Preis durch den zweiten, statt beider.</translation></message>
  <message><source>The output MET reports whether it is met.</source><translation>Die Ausgabe MET meldet, ob er erfüllt ist.</translation></message>
  <message><source>The report.json of each run; it represents the folder of the run.</source><translation>Die report.json jeder Auswertung; sie steht für deren Ordner.</translation></message>
  <message><source>The report.json of the run; it represents the folder of the run.</source><translation>Die report.json der Auswertung; sie steht für deren Ordner.</translation></message>
  <message><source>The rover stands still</source><translation>Der Rover steht still</translation></message>
  <message><source>The rover stands still.</source><translation>Der Rover steht still.</translation></message>
  <message><source>The session.toml beside the recording; 'Create a session file' writes one.</source><translation>Die session.toml neben der Aufzeichnung; „Eine Sitzungsdatei anlegen“ schreibt eine.</translation></message>
  <message><source>The year in which it begins; all seasons by default.</source><translation>Das Jahr, in dem sie beginnt; Vorgabe: alle Saisons.</translation></message>
  <message><source>Thin the points to this spacing; 0 keeps all points.</source><translation>Die Punkte auf diesen Abstand ausdünnen; 0 behält alle Punkte.</translation></message>
  <message><source>Threads</source><translation>Threads</translation></message>
  <message><source>Time of a video's first frame</source><translation>Zeit des ersten Bilds eines Videos</translation></message>
  <message><source>Time of the first frame of a video, such as 2026-05-23T09:41:12.345 (UTC, or with a zone).</source><translation>Zeit des ersten Bilds eines Videos, etwa 2026-05-23T09:41:12.345 (UTC oder mit Zeitzone).</translation></message>
  <message><source>Time zone</source><translation>Zeitzone</translation></message>
  <message><source>Time zone of dates and map tips, such as Asia/Tokyo [default: that of the run].</source><translation>Zeitzone von Daten und Kartenhinweisen, etwa Europe/Berlin [Vorgabe: die der Auswertung].</translation></message>
  <message><source>Track width</source><translation>Spurweite</translation></message>
  <message><source>Traffic</source><translation>Überfahrungen</translation></message>
  <message><source>Traffic: how often each spot was worked and driven on</source><translation>Überfahrungen: wie oft jede Stelle bearbeitet und befahren wurde</translation></message>
  <message><source>Treatments</source><translation>Varianten</translation></message>
  <message><source>Tyre width</source><translation>Reifenbreite</translation></message>
  <message><source>UTC date of the first position, for logs without a date.</source><translation>UTC-Datum der ersten Position, für Logs ohne Datum.</translation></message>
  <message><source>Unpack files of any size.</source><translation>Dateien jeder Größe entpacken.</translation></message>
  <message><source>Use every n-th frame</source><translation>Jedes n-te Bild verwenden</translation></message>
  <message><source>Use every n-th frame.</source><translation>Jedes n-te Bild verwenden.</translation></message>
  <message><source>Use the workers of this Dask scheduler: tls://HOST:PORT, or tcp:// without encryption.</source><translation>Die Worker dieses Dask-Schedulers verwenden: tls://HOST:PORT, oder tcp:// ohne Verschlüsselung.</translation></message>
  <message><source>Voxel size</source><translation>Voxelgröße</translation></message>
  <message><source>Voxel size, the smallest detail [default: the point spacing, 0.05 to 0.4].</source><translation>Voxelgröße, das kleinste Detail [Vorgabe: der Punktabstand, 0,05 bis 0,4].</translation></message>
  <message><source>Voxel size; keep the point nearest to the centre of each voxel.</source><translation>Voxelgröße; den Punkt behalten, der der Mitte jedes Voxels am nächsten liegt.</translation></message>
  <message><source>Whether numbers run along rows (from column to column) or along columns.</source><translation>Ob Nummern entlang der Reihen (von Spalte zu Spalte) oder der Spalten laufen.</translation></message>
  <message><source>Whether rows or columns are blocks (replicates).</source><translation>Ob Reihen oder Spalten Blöcke (Wiederholungen) sind.</translation></message>
  <message><source>Width of a plot</source><translation>Breite einer Parzelle</translation></message>
  <message><source>Width of a plot across the base line.</source><translation>Breite einer Parzelle quer zur Grundlinie.</translation></message>
  <message><source>Within polygons</source><translation>Innerhalb von Polygonen</translation></message>
  <message><source>Worked ground</source><translation>Bearbeiteter Boden</translation></message>
  <message><source>Worked ground from task data (ISOXML)</source><translation>Bearbeiteter Boden aus Auftragsdaten (ISOXML)</translation></message>
  <message><source>Workers</source><translation>Arbeitsprozesse</translation></message>
  <message><source>Working width</source><translation>Arbeitsbreite</translation></message>
  <message><source>Working width in metres [default: the largest in the logs].</source><translation>Arbeitsbreite in Metern [Vorgabe: die größte in den Logs].</translation></message>
  <message><source>Write a CSV table of the errors at each point.</source><translation>Eine CSV-Tabelle der Fehler an jedem Punkt schreiben.</translation></message>
  <message><source>Write a QGIS project for QField instead of a web page.</source><translation>Ein QGIS-Projekt für QField statt einer Webseite schreiben.</translation></message>
  <message><source>Write passes, overlaps and misses to this GeoPackage.</source><translation>Überfahrten, Überlappungen und Fehlstellen in dieses GeoPackage schreiben.</translation></message>
  <message><source>Write the estimates into SESSION; its other lines do not change.</source><translation>Die Schätzungen in SESSION schreiben; ihre anderen Zeilen bleiben unverändert.</translation></message>
  <message><source>Write the estimates into the session file</source><translation>Die Schätzungen in die Sitzungsdatei schreiben</translation></message>
  <message><source>Write the mounting into this machine's profile, with the day and the standard deviations.</source><translation>Den Einbau in das Profil dieser Maschine schreiben, mit dem Tag und den Standardabweichungen.</translation></message>
  <message><source>Writes a LAS, LAZ or COPC point cloud of any source in the colours of the images of a session. Each point takes the colour of the best image that sees it; points that no image sees are black.</source><translation>Schreibt eine LAS-, LAZ- oder COPC-Punktwolke beliebiger Herkunft in den Farben der Bilder einer Sitzung. Jeder Punkt nimmt die Farbe des besten Bilds, das ihn sieht; Punkte, die kein Bild sieht, sind schwarz.</translation></message>
  <message><source>Writes a simulated tractor recording: LiDAR packets, a GNSS log, a session file and the field boundary, with the ground truth. Useful to learn furrowmap and to plan a sensor mount.</source><translation>Schreibt eine simulierte Traktoraufzeichnung: LiDAR-Pakete, ein GNSS-Log, eine Sitzungsdatei und die Feldgrenze, mit den wahren Werten. Nützlich, um furrowmap kennenzulernen und einen Sensoreinbau zu planen.</translation></message>
  <message><source>Writes all sessions of a field in a farm map as a page with a map, or as a table (CSV).</source><translation>Schreibt alle Sitzungen eines Felds einer Betriebskarte als Seite mit Karte oder als Tabelle (CSV).</translation></message>
  <message><source>Writes one COPC file from LAS, LAZ or COPC point clouds of any source: on request, outliers become noise, ground is classified, and the cloud is thinned. Memory use does not depend on the size of the area.</source><translation>Schreibt eine COPC-Datei aus LAS-, LAZ- oder COPC-Punktwolken beliebiger Herkunft: Auf Wunsch werden Ausreißer zu Rauschen, wird Boden klassifiziert und die Punktwolke ausgedünnt. Der Speicherbedarf hängt nicht von der Größe des Gebiets ab.</translation></message>
  <message><source>Writes the result of a run as a folder for people without a GIS: a web page with map, layers, figures, point cloud in three dimensions and measuring, which opens from disk and needs no network; or a project for QField.</source><translation>Schreibt das Ergebnis einer Auswertung als Ordner für Menschen ohne GIS: eine Webseite mit Karte, Ebenen, Kennzahlen, dreidimensionaler Punktwolke und Messwerkzeug, die sich vom Datenträger öffnen lässt und kein Netz braucht; oder ein Projekt für QField.</translation></message>
  <message><source>dsm: after the work; dsm_before: before it; change: the difference.</source><translation>dsm: nach der Arbeit; dsm_before: davor; change: die Differenz.</translation></message>
  <message><source>fixed: leave out epochs without a fixed solution in the reference.</source><translation>fixed: Epochen ohne Fix-Lösung in der Referenz auslassen.</translation></message>
  <message><source>furrowmap's worker is not set up. Choose or create its environment in Settings › Options › furrowmap.</source><translation>Der Arbeitsprozess von furrowmap ist nicht eingerichtet. Seine Umgebung unter Einstellungen › Optionen › furrowmap wählen oder anlegen.</translation></message>
  <message><source>isoxml writes task data into a folder, or into a .zip if the output's name ends in .zip. Only stac accepts several results.</source><translation>isoxml schreibt Auftragsdaten in einen Ordner oder in eine .zip, wenn der Name der Ausgabe auf .zip endet. Nur stac nimmt mehrere Ergebnisse an.</translation></message>
  <message><source>parcels.csv of runs, one for each day.</source><translation>parcels.csv von Auswertungen, eine je Tag.</translation></message>
  <message><source>serpentine: every second row or column is numbered backwards.</source><translation>serpentine: Jede zweite Reihe oder Spalte wird rückwärts nummeriert.</translation></message>
  <message><source>{parameter}: '{text}' has the wrong format. {help}</source><translation>{parameter}: „{text}“ hat das falsche Format. {help}</translation></message>
  <message><source>{parameter}: {path} does not exist.</source><translation>{parameter}: {path} existiert nicht.</translation></message>
</context>
<context>
  <name>BaseMap</name>
  <message><source>'{own}' is not a base map. Give the address of a WMS or WMTS, a URL with {{z}}, {{x}} and {{y}}, or a file: MBTiles, GeoTIFF or another raster.</source><translation>„{own}“ ist keine Hintergrundkarte. Die Adresse eines WMS oder WMTS, eine URL mit {{z}}, {{x}} und {{y}} oder eine Datei angeben: MBTiles, GeoTIFF oder ein anderes Raster.</translation></message>
  <message><source>GSI aerial photo</source><translation>GSI-Luftbild</translation></message>
  <message><source>GSI standard map</source><translation>GSI-Standardkarte</translation></message>
  <message><source>Geospatial Information Authority of Japan (GSI) tiles</source><translation>Kacheln der Geospatial Information Authority of Japan (GSI)</translation></message>
  <message><source>Own base map</source><translation>Eigene Hintergrundkarte</translation></message>
  <message><source>{file} has vector tiles. Only raster tiles can be the base map.</source><translation>{file} enthält Vektorkacheln. Nur Rasterkacheln können Hintergrundkarte sein.</translation></message>
  <message><source>{file} states no CRS. Assign one in QGIS first.</source><translation>{file} nennt kein KBS. Zuerst in QGIS eines zuweisen.</translation></message>
  <message><source>© OpenStreetMap contributors</source><translation>© OpenStreetMap-Mitwirkende</translation></message>
</context>
<context>
  <name>BaseMapChooser</name>
  <message><source>Address of a WMS or WMTS; URL of tiles with {z}, {x} and {y}; or path of an MBTiles file, a GeoTIFF or another raster</source><translation>Adresse eines WMS oder WMTS; URL von Kacheln mit {z}, {x} und {y}; oder Pfad einer MBTiles-Datei, eines GeoTIFFs oder eines anderen Rasters</translation></message>
  <message><source>Address or file</source><translation>Adresse oder Datei</translation></message>
  <message><source>All files</source><translation>Alle Dateien</translation></message>
  <message><source>Attribution, if the map states none itself</source><translation>Quellenangabe, falls die Karte selbst keine nennt</translation></message>
  <message><source>Base map</source><translation>Hintergrundkarte</translation></message>
  <message><source>Layer</source><translation>Ebene</translation></message>
  <message><source>Rasters and MBTiles (*.mbtiles *.tif *.tiff *.vrt *.jp2 *.png *.jpg)</source><translation>Raster und MBTiles (*.mbtiles *.tif *.tiff *.vrt *.jp2 *.png *.jpg)</translation></message>
  <message><source>The base map {name} cannot be opened.</source><translation>Die Hintergrundkarte {name} lässt sich nicht öffnen.</translation></message>
  <message><source>The map of {host} cannot be reached: {reason}.
The other layers do not need it. Check the address and the network, or choose a map from a file.</source><translation>Die Karte von {host} ist nicht erreichbar: {reason}.
Die anderen Ebenen brauchen sie nicht. Adresse und Netz prüfen oder eine Karte aus einer Datei wählen.</translation></message>
  <message><source>none (offline)</source><translation>keine (offline)</translation></message>
  <message><source>other map…</source><translation>andere Karte …</translation></message>
  <message><source>{own} has no map layers of a WMS or WMTS.</source><translation>{own} hat keine Kartenebenen eines WMS oder WMTS.</translation></message>
</context>
<context>
  <name>BatchPage</name>
  <message><source>Add what is done to farm map…</source><translation>Fertige zur Betriebskarte hinzufügen …</translation></message>
  <message><source>Cancel</source><translation>Abbrechen</translation></message>
  <message><source>Double-click a drive to open its result, or its session where something is missing.</source><translation>Doppelklick auf eine Fahrt öffnet ihr Ergebnis oder ihre Sitzung, wo etwas fehlt.</translation></message>
  <message><source>It lasts {duration:.1f} s.</source><translation>Sie dauert {duration:.1f} s.</translation></message>
  <message><source>Other session</source><translation>Andere Sitzung</translation></message>
  <message><source>cancelled</source><translation>abgebrochen</translation></message>
  <message><source>done</source><translation>fertig</translation></message>
  <message><source>done, but it contradicts itself</source><translation>fertig, aber in sich widersprüchlich</translation></message>
  <message><source>done, but the recording is cut</source><translation>fertig, aber die Aufzeichnung ist abgeschnitten</translation></message>
  <message><source>failed</source><translation>fehlgeschlagen</translation></message>
  <message><source>not run: recordings or places are missing</source><translation>nicht ausgewertet: Aufzeichnungen oder Lagen fehlen</translation></message>
  <message><source>running</source><translation>läuft</translation></message>
  <message><source>waiting</source><translation>wartet</translation></message>
  <message><source>{ended} of {all} drives</source><translation>{ended} von {all} Fahrten</translation></message>
</context>
<context>
  <name>Classes</name>
  <message><source>ground</source><translation>Boden</translation></message>
  <message><source>high vegetation</source><translation>hohe Vegetation</translation></message>
  <message><source>horizontal plane</source><translation>waagerechte Fläche</translation></message>
  <message><source>implement</source><translation>Gerät</translation></message>
  <message><source>line</source><translation>Linie</translation></message>
  <message><source>low vegetation</source><translation>niedrige Vegetation</translation></message>
  <message><source>medium vegetation</source><translation>mittlere Vegetation</translation></message>
  <message><source>noise</source><translation>Rauschen</translation></message>
  <message><source>other</source><translation>sonstige</translation></message>
  <message><source>vehicle</source><translation>Fahrzeug</translation></message>
  <message><source>vertical plane</source><translation>senkrechte Fläche</translation></message>
</context>
<context>
  <name>DockWords</name>
  <message><source> under 'Results'</source><translation> unter „Ergebnisse“</translation></message>
  <message><source>'Camera', images</source><translation>„Kamera“, Bilder</translation></message>
  <message><source>'Field', boundary</source><translation>„Feld“, Grenze</translation></message>
  <message><source>'GNSS antenna', x, y, z</source><translation>„GNSS-Antenne“, x, y, z</translation></message>
  <message><source>'Implement', depth</source><translation>„Gerät“, Tiefe</translation></message>
  <message><source>'Implement', kind</source><translation>„Gerät“, Art</translation></message>
  <message><source>'Implement', width</source><translation>„Gerät“, Breite</translation></message>
  <message><source>'Implement', x, y</source><translation>„Gerät“, x, y</translation></message>
  <message><source>'Parcels', file</source><translation>„Parzellen“, Datei</translation></message>
  <message><source>'Parcels', treatments</source><translation>„Parzellen“, Varianten</translation></message>
  <message><source>'Results': </source><translation>„Ergebnisse“: </translation></message>
  <message><source>'Session', CRS</source><translation>„Sitzung“, KBS</translation></message>
  <message><source>'Session', recordings</source><translation>„Sitzung“, Aufzeichnungen</translation></message>
  <message><source>'{part}' in Settings › Options › furrowmap</source><translation>„{part}“ unter Einstellungen › Optionen › furrowmap</translation></message>
  <message><source>Camera</source><translation>Kamera</translation></message>
  <message><source>Farm maps in PostGIS</source><translation>Betriebskarten in PostGIS</translation></message>
  <message><source>GeoParquet</source><translation>GeoParquet</translation></message>
  <message><source>Ground by a cloth (CSF)</source><translation>Boden durch ein Tuch (CSF)</translation></message>
  <message><source>IMU</source><translation>IMU</translation></message>
  <message><source>Images of cameras (OpenCV, Pillow)</source><translation>Kamerabilder (OpenCV, Pillow)</translation></message>
  <message><source>ROS bags</source><translation>ROS-Bags</translation></message>
  <message><source>Recordings in cloud storage</source><translation>Aufzeichnungen im Cloud-Speicher</translation></message>
  <message><source>Scanner</source><translation>Scanner</translation></message>
  <message><source>Statistics of trials and spreadsheets</source><translation>Versuchsstatistik und Tabellenkalkulationen</translation></message>
  <message><source>roll, pitch, yaw</source><translation>Roll, Pitch, Gier</translation></message>
  <message><source>x, y, z</source><translation>x, y, z</translation></message>
</context>
<context>
  <name>Figures</name>
  <message><source>, </source><translation>, </translation></message>
  <message><source>Accuracy</source><translation>Genauigkeit</translation></message>
  <message><source>CRS</source><translation>KBS</translation></message>
  <message><source>Crop height</source><translation>Bestandeshöhe</translation></message>
  <message><source>Crop volume</source><translation>Bestandesvolumen</translation></message>
  <message><source>Duration</source><translation>Dauer</translation></message>
  <message><source>Field</source><translation>Feld</translation></message>
  <message><source>Heading accuracy</source><translation>Heading-Genauigkeit</translation></message>
  <message><source>Horizontal accuracy</source><translation>Horizontale Genauigkeit</translation></message>
  <message><source>Missed</source><translation>Ausgelassen</translation></message>
  <message><source>Not worked</source><translation>Nicht bearbeitet</translation></message>
  <message><source>Overlap</source><translation>Überlappung</translation></message>
  <message><source>PPP</source><translation>PPP</translation></message>
  <message><source>Parcels</source><translation>Parzellen</translation></message>
  <message><source>Passes</source><translation>Überfahrten</translation></message>
  <message><source>Path length</source><translation>Weglänge</translation></message>
  <message><source>Points</source><translation>Punkte</translation></message>
  <message><source>Positions</source><translation>Positionen</translation></message>
  <message><source>RTK fixed</source><translation>RTK-Fix</translation></message>
  <message><source>RTK float</source><translation>RTK-Float</translation></message>
  <message><source>Response</source><translation>Wirkung</translation></message>
  <message><source>Start</source><translation>Beginn</translation></message>
  <message><source>This explains:</source><translation>Dies erklärt:</translation></message>
  <message><source>Vertical accuracy</source><translation>Vertikale Genauigkeit</translation></message>
  <message><source>Worked</source><translation>Bearbeitet</translation></message>
  <message><source>depends on what the recording does not show: {keys}</source><translation>hängt von dem ab, was die Aufzeichnung nicht zeigt: {keys}</translation></message>
  <message><source>differential</source><translation>differenziell</translation></message>
  <message><source>no position</source><translation>keine Position</translation></message>
  <message><source>orientation of the scanner</source><translation>Ausrichtung des Scanners</translation></message>
  <message><source>other</source><translation>sonstige</translation></message>
  <message><source>position of the antenna</source><translation>Lage der Antenne</translation></message>
  <message><source>position of the scanner</source><translation>Lage des Scanners</translation></message>
  <message><source>single</source><translation>einzeln</translation></message>
  <message><source>unknown, because the session leaves out: {keys}</source><translation>unbekannt, weil in der Sitzung fehlt: {keys}</translation></message>
  <message><source>{area}, {share:.0f} % of it worked</source><translation>{area}, davon {share:.0f} % bearbeitet</translation></message>
  <message><source>{low:.1f} to {high:.1f} cm, mean {mean:.1f} cm</source><translation>{low:.1f} bis {high:.1f} cm, Mittel {mean:.1f} cm</translation></message>
</context>
<context>
  <name>Findings</name>
  <message><source>CRS: the recordings contain no position.</source><translation>KBS: Die Aufzeichnungen enthalten keine Position.</translation></message>
  <message><source>Camera: fx, fy, cx and cy. Until then the images are not used.</source><translation>Kamera: fx, fy, cx und cy. Bis dahin werden die Bilder nicht verwendet.</translation></message>
  <message><source>Found in the recordings: {kind}</source><translation>In den Aufzeichnungen gefunden: {kind}</translation></message>
  <message><source>GNSS antenna: position. Until then no accuracy is stated.</source><translation>GNSS-Antenne: Lage. Bis dahin wird keine Genauigkeit angegeben.</translation></message>
  <message><source>IMU: position and rotation of its axes. Until then its axes are those of the vehicle.</source><translation>IMU: Lage und Drehung ihrer Achsen. Bis dahin gelten ihre Achsen als die des Fahrzeugs.</translation></message>
  <message><source>IMU: position. Until then it is taken as that of the antenna.</source><translation>IMU: Lage. Bis dahin gilt die der Antenne.</translation></message>
  <message><source>Implement: width and position. Until then no worked ground is computed.</source><translation>Gerät: Breite und Lage. Bis dahin wird kein bearbeiteter Boden berechnet.</translation></message>
  <message><source>Missing</source><translation>Fehlt</translation></message>
  <message><source>Not used</source><translation>Nicht verwendet</translation></message>
  <message><source>Scanner: position and orientation. Until then the surfaces are not usable.</source><translation>Scanner: Lage und Ausrichtung. Bis dahin sind die Oberflächen nicht brauchbar.</translation></message>
  <message><source>Scanner: position. Until then no accuracy is stated.</source><translation>Scanner: Lage. Bis dahin wird keine Genauigkeit angegeben.</translation></message>
  <message><source>The receiver's log. Drop it together with the scanner's recording.</source><translation>Das Log des Empfängers. Es zusammen mit der Aufzeichnung des Scanners ablegen.</translation></message>
  <message><source>The scanner's recording. Drop it together with the receiver's log.</source><translation>Die Aufzeichnung des Scanners. Sie zusammen mit dem Log des Empfängers ablegen.</translation></message>
  <message><source>To check</source><translation>Zu prüfen</translation></message>
  <message><source>a drive</source><translation>eine Fahrt</translation></message>
  <message><source>a flight</source><translation>ein Flug</translation></message>
  <message><source>positions alone</source><translation>nur Positionen</translation></message>
  <message><source>scans alone</source><translation>nur Scans</translation></message>
</context>
<context>
  <name>FlightParts</name>
  <message><source>Camera</source><translation>Kamera</translation></message>
  <message><source>Choose the camera's table of images, or uncheck 'Camera'.</source><translation>Die Bildtabelle der Kamera wählen oder „Kamera“ abwählen.</translation></message>
  <message><source>Class</source><translation>Klasse</translation></message>
  <message><source>Enter it: {name} = {value}</source><translation>Eintragen: {name} = {value}</translation></message>
  <message><source>Enter the size of the images, fx, fy, cx and cy of the camera.</source><translation>Bildgröße, fx, fy, cx und cy der Kamera eintragen.</translation></message>
  <message><source>File</source><translation>Datei</translation></message>
  <message><source>Files</source><translation>Dateien</translation></message>
  <message><source>IMU</source><translation>IMU</translation></message>
  <message><source>Images</source><translation>Bilder</translation></message>
  <message><source>Its class, or its model, such as VN-200. Empty: industrial.</source><translation>Ihre Klasse oder ihr Modell, etwa VN-200. Leer: industrial.</translation></message>
  <message><source>Optional: the parcels of a trial, for heights and volumes of the crop. The net parcel lies so far inside. Treatments: a table with the identifier of each parcel.</source><translation>Optional: die Parzellen eines Versuchs, für Höhen und Volumen des Bestands. So weit innen liegt die Nettoparzelle. Varianten: eine Tabelle mit der Kennung jeder Parzelle.</translation></message>
  <message><source>Parcels</source><translation>Parzellen</translation></message>
  <message><source>Polygons (*.geojson *.gpkg *.shp *.kml *.csv)</source><translation>Polygone (*.geojson *.gpkg *.shp *.kml *.csv)</translation></message>
  <message><source>Position of the IMU, and rotation of its axes from forward, left, up. An IMU whose z axis points down has 180, 0, 0.</source><translation>Lage der IMU und Drehung ihrer Achsen gegen vorn, links, oben. Eine IMU, deren z-Achse nach unten zeigt, hat 180, 0, 0.</translation></message>
  <message><source>Tables (*.csv *.xlsx)</source><translation>Tabellen (*.csv *.xlsx)</translation></message>
  <message><source>Tables (*.csv)</source><translation>Tabellen (*.csv)</translation></message>
  <message><source>The table has a row for each image: file and time (UTC). Rotation of the optical frame: x right in the image, y down, z along the view; looking down with the top of the image forward: 180, 0, -90. Unchecked: no images are used.</source><translation>Die Tabelle hat eine Zeile je Bild: Datei und Zeit (UTC). Drehung des optischen Systems: x im Bild nach rechts, y nach unten, z in Blickrichtung; bei Blick nach unten mit der Bildoberkante vorn: 180, 0, -90. Abgewählt: Es werden keine Bilder verwendet.</translation></message>
  <message><source>Treatments</source><translation>Varianten</translation></message>
  <message><source>clock of the IMU minus GNSS time (s)</source><translation>Uhr der IMU minus GNSS-Zeit (s)</translation></message>
  <message><source>clock of the scanner minus GNSS time (s)</source><translation>Uhr des Scanners minus GNSS-Zeit (s)</translation></message>
  <message><source>clock of the tool's states minus GNSS time (s)</source><translation>Uhr der Gerätezustände minus GNSS-Zeit (s)</translation></message>
  <message><source>distortion k1, k2</source><translation>Verzeichnung k1, k2</translation></message>
  <message><source>distortion p1, p2</source><translation>Verzeichnung p1, p2</translation></message>
  <message><source>focal length fx, fy</source><translation>Brennweite fx, fy</translation></message>
  <message><source>off each end, off each side</source><translation>an jedem Ende, an jeder Seite</translation></message>
  <message><source>principal point cx, cy</source><translation>Hauptpunkt cx, cy</translation></message>
  <message><source>roll, pitch, yaw</source><translation>Roll, Pitch, Gier</translation></message>
  <message><source>roll, pitch, yaw of the IMU</source><translation>Roll, Pitch, Gier der IMU</translation></message>
  <message><source>width, height</source><translation>Breite, Höhe</translation></message>
  <message><source>x, y, z</source><translation>x, y, z</translation></message>
</context>
<context>
  <name>FurrowmapDock</name>
  <message><source>A part of furrowmap is not installed: {part}.</source><translation>Ein Teil von furrowmap ist nicht installiert: {part}.</translation></message>
  <message><source>A task is running. Wait for its end, or cancel it.</source><translation>Eine Aufgabe läuft. Ihr Ende abwarten oder sie abbrechen.</translation></message>
  <message><source>Add the session to the map first.</source><translation>Die Sitzung zuerst zur Karte hinzufügen.</translation></message>
  <message><source>Added the machine {name}. Choose it in the form of a session.</source><translation>Maschine {name} hinzugefügt. Sie im Formular einer Sitzung wählen.</translation></message>
  <message><source>Adding to the farm map</source><translation>Wird zur Betriebskarte hinzugefügt</translation></message>
  <message><source>Calibrated: the recording shows no other angles than the session states.</source><translation>Kalibriert: Die Aufzeichnung zeigt keine anderen Winkel, als die Sitzung angibt.</translation></message>
  <message><source>Calibrated: the session has the angles that the recording shows.</source><translation>Kalibriert: Die Sitzung hat die Winkel, die die Aufzeichnung zeigt.</translation></message>
  <message><source>Calibrating</source><translation>Kalibrieren</translation></message>
  <message><source>Cancelled; no partial files are left.</source><translation>Abgebrochen; es bleiben keine unvollständigen Dateien zurück.</translation></message>
  <message><source>Choose another folder for the results.</source><translation>Einen anderen Ordner für die Ergebnisse wählen.</translation></message>
  <message><source>Copy the recordings to a folder of this computer; they are not changed.</source><translation>Die Aufzeichnungen in einen Ordner dieses Rechners kopieren; sie werden nicht geändert.</translation></message>
  <message><source>Copying the recordings</source><translation>Aufzeichnungen werden kopiert</translation></message>
  <message><source>Exported to {path}</source><translation>Exportiert nach {path}</translation></message>
  <message><source>Exporting</source><translation>Exportieren</translation></message>
  <message><source>Farm map</source><translation>Betriebskarte</translation></message>
  <message><source>File or folder of the export</source><translation>Datei oder Ordner des Exports</translation></message>
  <message><source>Folder for the copy of the recordings, the session and the results</source><translation>Ordner für die Kopie der Aufzeichnungen, die Sitzung und die Ergebnisse</translation></message>
  <message><source>Folder for the results</source><translation>Ordner für die Ergebnisse</translation></message>
  <message><source>Folder of the page</source><translation>Ordner der Seite</translation></message>
  <message><source>Folder of the project</source><translation>Ordner des Projekts</translation></message>
  <message><source>Inspecting the recordings</source><translation>Aufzeichnungen werden untersucht</translation></message>
  <message><source>Install…</source><translation>Installieren …</translation></message>
  <message><source>Log</source><translation>Protokoll</translation></message>
  <message><source>Make surfaces…</source><translation>Oberflächen erzeugen …</translation></message>
  <message><source>Opened the existing session of these recordings.</source><translation>Die vorhandene Sitzung dieser Aufzeichnungen ist geöffnet.</translation></message>
  <message><source>Running {name}</source><translation>{name} wird ausgewertet</translation></message>
  <message><source>Saved the machine {name}.</source><translation>Maschine {name} gespeichert.</translation></message>
  <message><source>Saved {path}</source><translation>{path} gespeichert</translation></message>
  <message><source>Saving the machine</source><translation>Maschine wird gespeichert</translation></message>
  <message><source>Set up furrowmap's worker to run sessions. Results can be opened without it.</source><translation>Den Arbeitsprozess von furrowmap einrichten, um Sitzungen auszuwerten. Ergebnisse lassen sich ohne ihn öffnen.</translation></message>
  <message><source>The drives are still running. Wait for their end, or cancel them in their list.</source><translation>Die Fahrten laufen noch. Ihr Ende abwarten oder sie in ihrer Liste abbrechen.</translation></message>
  <message><source>The form cannot edit line {number} of {name}.</source><translation>Das Formular kann Zeile {number} von {name} nicht bearbeiten.</translation></message>
  <message><source>The machine {name} has them for its next sessions.</source><translation>Die Maschine {name} hat sie für ihre nächsten Sitzungen.</translation></message>
  <message><source>The previous task is being cancelled; try again in a moment.</source><translation>Die vorige Aufgabe wird abgebrochen; gleich erneut versuchen.</translation></message>
  <message><source>The session can be run as it is.</source><translation>Die Sitzung lässt sich auswerten, wie sie ist.</translation></message>
  <message><source>The session can be run as it is. The results in {folder} are then replaced.</source><translation>Die Sitzung lässt sich auswerten, wie sie ist. Die Ergebnisse in {folder} werden dann ersetzt.</translation></message>
  <message><source>The session file of this result is not there any more: {path}.</source><translation>Die Sitzungsdatei dieses Ergebnisses ist nicht mehr da: {path}.</translation></message>
  <message><source>The session is outside of the area of the project's CRS, {crs}: shapes are wrong.</source><translation>Die Sitzung liegt außerhalb des Gültigkeitsbereichs des Projekt-KBS {crs}: Formen sind verzerrt.</translation></message>
  <message><source>The task had ended before it could be cancelled.</source><translation>Die Aufgabe war schon zu Ende, bevor sie abgebrochen werden konnte.</translation></message>
  <message><source>This QGIS has no 3D views.</source><translation>Dieses QGIS hat keine 3D-Ansichten.</translation></message>
  <message><source>This drive has not ended yet.</source><translation>Diese Fahrt ist noch nicht fertig.</translation></message>
  <message><source>Use {crs}</source><translation>{crs} verwenden</translation></message>
  <message><source>{count} sessions in the farm map.</source><translation>{count} Sitzungen in der Betriebskarte.</translation></message>
  <message><source>{folder} is read-only, so that neither a session nor results can be written there.</source><translation>{folder} ist schreibgeschützt; dort lassen sich weder eine Sitzung noch Ergebnisse schreiben.</translation></message>
  <message><source>{folder} is read-only, so that the results cannot be written there.</source><translation>{folder} ist schreibgeschützt; dort lassen sich die Ergebnisse nicht schreiben.</translation></message>
  <message><source>{names}: a point cloud alone needs no session. Surfaces can be made of it.</source><translation>{names}: Eine Punktwolke allein braucht keine Sitzung. Aus ihr lassen sich Oberflächen erzeugen.</translation></message>
  <message><source>{path} cannot be added: {reason}.</source><translation>{path} lässt sich nicht hinzufügen: {reason}.</translation></message>
  <message><source>{path} cannot be read: {reason}.</source><translation>{path} ist nicht lesbar: {reason}.</translation></message>
  <message><source>{path} does not exist.</source><translation>{path} existiert nicht.</translation></message>
  <message><source>{path} was not opened: this computer has no program for it.</source><translation>{path} wurde nicht geöffnet: Dieser Rechner hat kein Programm dafür.</translation></message>
</context>
<context>
  <name>FurrowmapPlugin</name>
  <message><source>furrowmap</source><translation>furrowmap</translation></message>
</context>
<context>
  <name>Installer</name>
  <message><source>Check the network, or install from a folder of wheels.</source><translation>Das Netz prüfen oder aus einem Ordner mit Wheels installieren.</translation></message>
  <message><source>Choose a wheel of furrowmap, its source checkout, or a folder of wheels with the plugin's version.</source><translation>Ein Wheel von furrowmap, dessen Quell-Checkout oder einen Ordner mit Wheels in der Version des Plugins wählen.</translation></message>
  <message><source>Compiling: this takes some minutes, once.</source><translation>Kompilieren: Dies dauert einmalig einige Minuten.</translation></message>
  <message><source>Download the wheels with the same version of Python on the same kind of computer.</source><translation>Die Wheels mit derselben Python-Version auf derselben Art von Rechner herunterladen.</translation></message>
  <message><source>Install Python from python.org; on Debian and Ubuntu the package python3-venv. Then try again.</source><translation>Python von python.org installieren; unter Debian und Ubuntu das Paket python3-venv. Dann erneut versuchen.</translation></message>
  <message><source>Install the packages in the way in which furrowmap was installed.</source><translation>Die Pakete auf dem Weg installieren, auf dem furrowmap installiert wurde.</translation></message>
  <message><source>Installing failed: {reason}</source><translation>Installation fehlgeschlagen: {reason}</translation></message>
  <message><source>No Python {oldest} to {newest} with venv was found.</source><translation>Kein Python {oldest} bis {newest} mit venv gefunden.</translation></message>
  <message><source>The checksum of {package} differs from the plugin's list.</source><translation>Die Prüfsumme von {package} weicht von der Liste des Plugins ab.</translation></message>
  <message><source>The environment was not created; an existing one is unchanged.</source><translation>Die Umgebung wurde nicht angelegt; eine vorhandene ist unverändert.</translation></message>
  <message><source>The file is damaged or not the original. Download the wheels again, or use another source.</source><translation>Die Datei ist beschädigt oder nicht das Original. Die Wheels erneut herunterladen oder eine andere Quelle verwenden.</translation></message>
  <message><source>The log above has the details.</source><translation>Das Protokoll oben enthält die Einzelheiten.</translation></message>
  <message><source>The package index cannot be reached.</source><translation>Der Paketindex ist nicht erreichbar.</translation></message>
  <message><source>There is no wheel of {package} for this computer and this Python.</source><translation>Für diesen Rechner und dieses Python gibt es kein Wheel von {package}.</translation></message>
  <message><source>{folder} has no wheel of {package} for this Python.</source><translation>{folder} enthält kein Wheel von {package} für dieses Python.</translation></message>
  <message><source>{program} has no Python beside it.</source><translation>Neben {program} liegt kein Python.</translation></message>
  <message><source>{program} is not furrowmap.</source><translation>{program} ist nicht furrowmap.</translation></message>
  <message><source>{source} has no furrowmap {version}.</source><translation>{source} enthält kein furrowmap {version}.</translation></message>
</context>
<context>
  <name>Interpreter</name>
  <message><source>Chosen below.</source><translation>Unten gewählt.</translation></message>
  <message><source>Created by this plugin.</source><translation>Von diesem Plugin angelegt.</translation></message>
  <message><source>Found on the PATH.</source><translation>Im PATH gefunden.</translation></message>
  <message><source>It installed this plugin with 'furrowmap qgis install'.</source><translation>Es hat dieses Plugin mit „furrowmap qgis install“ installiert.</translation></message>
  <message><source>None found. Existing results can be opened; to run sessions, choose or create one.</source><translation>Keines gefunden. Vorhandene Ergebnisse lassen sich öffnen; zum Auswerten von Sitzungen eines wählen oder anlegen.</translation></message>
</context>
<context>
  <name>Legends</name>
  <message><source>1.2 m and more</source><translation>1,2 m und mehr</translation></message>
  <message><source>2 m and more</source><translation>2 m und mehr</translation></message>
  <message><source>4 and more</source><translation>4 und mehr</translation></message>
  <message><source>Boundary of the field</source><translation>Feldgrenze</translation></message>
  <message><source>Change from date {earlier} to date {later}</source><translation>Änderung von Zeitpunkt {earlier} zu Zeitpunkt {later}</translation></message>
  <message><source>Change of the surface</source><translation>Änderung der Oberfläche</translation></message>
  <message><source>Control points</source><translation>Passpunkte</translation></message>
  <message><source>Cultivated path</source><translation>Bearbeitete Spur</translation></message>
  <message><source>Depth of water (m)</source><translation>Wassertiefe (m)</translation></message>
  <message><source>Differences of strips</source><translation>Differenzen der Streifen</translation></message>
  <message><source>Differences of swaths</source><translation>Differenzen der Streifen</translation></message>
  <message><source>Events of the drive</source><translation>Ereignisse der Fahrt</translation></message>
  <message><source>Fields</source><translation>Felder</translation></message>
  <message><source>Ground not worked</source><translation>Nicht bearbeiteter Boden</translation></message>
  <message><source>Ground worked twice</source><translation>Doppelt bearbeiteter Boden</translation></message>
  <message><source>Growth of the crop</source><translation>Zuwachs des Bestands</translation></message>
  <message><source>Headland and body</source><translation>Vorgewende und Feldinneres</translation></message>
  <message><source>Height above ground</source><translation>Höhe über dem Boden</translation></message>
  <message><source>Height above ground (m)</source><translation>Höhe über dem Boden (m)</translation></message>
  <message><source>Height change (m)</source><translation>Höhenänderung (m)</translation></message>
  <message><source>Height difference of swaths (mm)</source><translation>Höhendifferenz der Streifen (mm)</translation></message>
  <message><source>Height of the canopy</source><translation>Bestandeshöhe</translation></message>
  <message><source>Height of the canopy (m)</source><translation>Bestandeshöhe (m)</translation></message>
  <message><source>Height of the crop</source><translation>Bestandeshöhe</translation></message>
  <message><source>Height of the crop (m)</source><translation>Bestandeshöhe (m)</translation></message>
  <message><source>Low spots</source><translation>Senken</translation></message>
  <message><source>Machines</source><translation>Maschinen</translation></message>
  <message><source>Missed ground</source><translation>Ausgelassener Boden</translation></message>
  <message><source>Number of strips</source><translation>Anzahl der Streifen</translation></message>
  <message><source>Orthophoto</source><translation>Orthofoto</translation></message>
  <message><source>Parcels of the trial</source><translation>Parzellen des Versuchs</translation></message>
  <message><source>Passes of the tool</source><translation>Überfahrten des Geräts</translation></message>
  <message><source>Paths of the vehicle</source><translation>Wege des Fahrzeugs</translation></message>
  <message><source>Point cloud of the run</source><translation>Punktwolke der Auswertung</translation></message>
  <message><source>Points a square metre</source><translation>Punkte je Quadratmeter</translation></message>
  <message><source>Positions of the vehicle</source><translation>Positionen des Fahrzeugs</translation></message>
  <message><source>Relief</source><translation>Relief</translation></message>
  <message><source>Relief after the work</source><translation>Relief nach der Arbeit</translation></message>
  <message><source>Relief before the work</source><translation>Relief vor der Arbeit</translation></message>
  <message><source>Relief of the ground</source><translation>Relief des Bodens</translation></message>
  <message><source>Reports and settings of the sessions</source><translation>Berichte und Einstellungen der Sitzungen</translation></message>
  <message><source>Roughness</source><translation>Rauheit</translation></message>
  <message><source>Roughness (m)</source><translation>Rauheit (m)</translation></message>
  <message><source>Sessions</source><translation>Sitzungen</translation></message>
  <message><source>Slope</source><translation>Neigung</translation></message>
  <message><source>Slope (°)</source><translation>Neigung (°)</translation></message>
  <message><source>Strips of the flight</source><translation>Streifen des Flugs</translation></message>
  <message><source>Surface</source><translation>Oberfläche</translation></message>
  <message><source>Surface after the work</source><translation>Oberfläche nach der Arbeit</translation></message>
  <message><source>Surface before the work</source><translation>Oberfläche vor der Arbeit</translation></message>
  <message><source>Surface of the ground</source><translation>Oberfläche des Bodens</translation></message>
  <message><source>Work of each season</source><translation>Arbeit jeder Saison</translation></message>
  <message><source>Work of each session</source><translation>Arbeit jeder Sitzung</translation></message>
  <message><source>Worked ground</source><translation>Bearbeiteter Boden</translation></message>
  <message><source>none: turns alone</source><translation>keine: nur Wenden</translation></message>
  <message><source>unknown</source><translation>unbekannt</translation></message>
</context>
<context>
  <name>Options</name>
  <message><source>A task of furrowmap is running. Wait for its end, or cancel it.</source><translation>Eine Aufgabe von furrowmap läuft. Ihr Ende abwarten oder sie abbrechen.</translation></message>
  <message><source>Another one (a Python interpreter with furrowmap, or the furrowmap command):</source><translation>Eine andere (ein Python-Interpreter mit furrowmap oder der Befehl furrowmap):</translation></message>
  <message><source>Cancel</source><translation>Abbrechen</translation></message>
  <message><source>Cancelled; nothing was changed.</source><translation>Abgebrochen; es wurde nichts geändert.</translation></message>
  <message><source>Choose where furrowmap is to be installed from.</source><translation>Wählen, woraus furrowmap installiert werden soll.</translation></message>
  <message><source>Create a Python environment for furrowmap in {folder}? It takes {size} MB on the disk. QGIS's Python is not changed.</source><translation>Eine Python-Umgebung für furrowmap in {folder} anlegen? Sie belegt {size} MB auf dem Datenträger. Das Python von QGIS wird nicht geändert.</translation></message>
  <message><source>Create environment…</source><translation>Umgebung anlegen …</translation></message>
  <message><source>Created in {folder}</source><translation>Angelegt in {folder}</translation></message>
  <message><source>Created in {folder} ({size} MB)</source><translation>Angelegt in {folder} ({size} MB)</translation></message>
  <message><source>Creating furrowmap's environment</source><translation>Umgebung von furrowmap wird angelegt</translation></message>
  <message><source>Delete furrowmap's environment in {folder}? Sessions cannot be run without it.</source><translation>Umgebung von furrowmap in {folder} löschen? Ohne sie lassen sich keine Sitzungen auswerten.</translation></message>
  <message><source>Delete…</source><translation>Löschen …</translation></message>
  <message><source>Deleting furrowmap's environment</source><translation>Umgebung von furrowmap wird gelöscht</translation></message>
  <message><source>Environment of the plugin</source><translation>Umgebung des Plugins</translation></message>
  <message><source>Found automatically</source><translation>Automatisch gefunden</translation></message>
  <message><source>From a folder with the wheels of furrowmap and its dependencies (offline)</source><translation>Aus einem Ordner mit den Wheels von furrowmap und seinen Abhängigkeiten (offline)</translation></message>
  <message><source>From a wheel or source checkout; dependencies from the package index (240 MB to download)</source><translation>Aus einem Wheel oder Quell-Checkout; Abhängigkeiten aus dem Paketindex (240 MB herunterzuladen)</translation></message>
  <message><source>Further parts of furrowmap</source><translation>Weitere Teile von furrowmap</translation></message>
  <message><source>Install</source><translation>Installieren</translation></message>
  <message><source>Installed: {packages}.</source><translation>Installiert: {packages}.</translation></message>
  <message><source>Installing packages</source><translation>Pakete werden installiert</translation></message>
  <message><source>It works: {program}</source><translation>Es funktioniert: {program}</translation></message>
  <message><source>None</source><translation>Keine</translation></message>
  <message><source>Not created. Folder: {folder}</source><translation>Nicht angelegt. Ordner: {folder}</translation></message>
  <message><source>Test</source><translation>Prüfen</translation></message>
  <message><source>Testing furrowmap</source><translation>furrowmap wird geprüft</translation></message>
  <message><source>The environment is ready: furrowmap {version}.</source><translation>Die Umgebung ist bereit: furrowmap {version}.</translation></message>
  <message><source>The environment was deleted.</source><translation>Die Umgebung wurde gelöscht.</translation></message>
  <message><source>Wheel or checkout (furrowmap-*.whl pyproject.toml)</source><translation>Wheel oder Checkout (furrowmap-*.whl pyproject.toml)</translation></message>
  <message><source>furrowmap in use</source><translation>Verwendetes furrowmap</translation></message>
</context>
<context>
  <name>PassLocator</name>
  <message><source>Pass {number}</source><translation>Überfahrt {number}</translation></message>
  <message><source>furrowmap passes</source><translation>furrowmap-Überfahrten</translation></message>
</context>
<context>
  <name>Places</name>
  <message><source>there is a file or folder of this name already</source><translation>eine Datei oder ein Ordner dieses Namens ist schon da</translation></message>
  <message><source>{needed:,.1f} GB are needed, {free:,.1f} GB are free</source><translation>{needed:,.1f} GB sind nötig, {free:,.1f} GB sind frei</translation></message>
</context>
<context>
  <name>Previewer</name>
  <message><source>No preview: {reason}</source><translation>Keine Vorschau: {reason}</translation></message>
  <message><source>Preview on the map: {figures}.</source><translation>Vorschau auf der Karte: {figures}.</translation></message>
  <message><source>Preview: {stage}…</source><translation>Vorschau: {stage} …</translation></message>
  <message><source>starting</source><translation>Beginn</translation></message>
</context>
<context>
  <name>Previews</name>
  <message><source>Preview: {name}</source><translation>Vorschau: {name}</translation></message>
  <message><source>coarse surface</source><translation>grobe Oberfläche</translation></message>
  <message><source>the times or positions are damaged</source><translation>die Zeiten oder Positionen sind beschädigt</translation></message>
  <message><source>trajectory</source><translation>Trajektorie</translation></message>
  <message><source>{distance:,.0f} m in {time:,.0f} s</source><translation>{distance:,.0f} m in {time:,.0f} s</translation></message>
  <message><source>{share:.0%} RTK fixed</source><translation>{share:.0%} RTK-Fix</translation></message>
</context>
<context>
  <name>ResultPage</name>
  <message><source>3D view</source><translation>3D-Ansicht</translation></message>
  <message><source>A layout with map, legend and figures, and a page per pass</source><translation>Ein Layout mit Karte, Legende und Kennzahlen und einer Seite je Überfahrt</translation></message>
  <message><source>Add to farm map…</source><translation>Zur Betriebskarte hinzufügen …</translation></message>
  <message><source>Add to map</source><translation>Zur Karte hinzufügen</translation></message>
  <message><source>Back to its form, to change it and run it again</source><translation>Zurück zum Formular, um es zu ändern und erneut auszuwerten</translation></message>
  <message><source>Back to the drives</source><translation>Zurück zu den Fahrten</translation></message>
  <message><source>CSV of poses: the trajectory, for furrowmap</source><translation>CSV der Posen: die Trajektorie, für furrowmap</translation></message>
  <message><source>CSV: spreadsheets</source><translation>CSV: Tabellenkalkulationen</translation></message>
  <message><source>Edit this session</source><translation>Diese Sitzung bearbeiten</translation></message>
  <message><source>Export</source><translation>Exportieren</translation></message>
  <message><source>FlatGeobuf: web maps</source><translation>FlatGeobuf: Webkarten</translation></message>
  <message><source>GeoJSON: web maps, in WGS 84</source><translation>GeoJSON: Webkarten, in WGS 84</translation></message>
  <message><source>GeoPackage: any GIS, with styles</source><translation>GeoPackage: jedes GIS, mit Stilen</translation></message>
  <message><source>GeoParquet: analysis in Python, R or DuckDB</source><translation>GeoParquet: Auswertung in Python, R oder DuckDB</translation></message>
  <message><source>ISO 11783 task data: farm software</source><translation>Auftragsdaten nach ISO 11783: Büro-Software</translation></message>
  <message><source>KML: Google Earth</source><translation>KML: Google Earth</translation></message>
  <message><source>On the map</source><translation>Auf der Karte</translation></message>
  <message><source>One file of all sessions, a layer for each kind</source><translation>Eine Datei aller Sitzungen, eine Ebene je Art</translation></message>
  <message><source>Open folder</source><translation>Ordner öffnen</translation></message>
  <message><source>Open report</source><translation>Bericht öffnen</translation></message>
  <message><source>Open the HTML report in the browser</source><translation>Den HTML-Bericht im Browser öffnen</translation></message>
  <message><source>Open the folder of the products</source><translation>Den Ordner der Produkte öffnen</translation></message>
  <message><source>Open the products as styled layers in a group</source><translation>Die Produkte als Ebenen mit Stilen in einer Gruppe öffnen</translation></message>
  <message><source>Other session</source><translation>Andere Sitzung</translation></message>
  <message><source>Play the drive; ground worked, change and a visible cloud grow with it</source><translation>Die Fahrt abspielen; bearbeiteter Boden, Änderung und eine sichtbare Punktwolke wachsen mit</translation></message>
  <message><source>Print…</source><translation>Drucken …</translation></message>
  <message><source>Project for QField…</source><translation>Projekt für QField …</translation></message>
  <message><source>Replay</source><translation>Abspielen</translation></message>
  <message><source>SBET: the trajectory, for LiDAR software</source><translation>SBET: die Trajektorie, für LiDAR-Software</translation></message>
  <message><source>STAC: a catalogue of the products</source><translation>STAC: ein Katalog der Produkte</translation></message>
  <message><source>Shapefile: older GIS</source><translation>Shapefile: ältere GIS</translation></message>
  <message><source>TUM: the trajectory, for robotics</source><translation>TUM: die Trajektorie, für die Robotik</translation></message>
  <message><source>The visible layers in three dimensions</source><translation>Die sichtbaren Ebenen dreidimensional</translation></message>
  <message><source>This folder has no report, so the accuracy is unknown.</source><translation>Dieser Ordner enthält keinen Bericht; die Genauigkeit ist unbekannt.</translation></message>
  <message><source>Warnings</source><translation>Warnungen</translation></message>
  <message><source>Web page with map and 3D, to share…</source><translation>Webseite mit Karte und 3D, zum Teilen …</translation></message>
  <message><source>glTF: the surface in 3D, with its orthophoto</source><translation>glTF: die Oberfläche in 3D, mit ihrem Orthofoto</translation></message>
  <message><source>{count} more warnings below the figures</source><translation>{count} weitere Warnungen unter den Kennzahlen</translation></message>
</context>
<context>
  <name>Results</name>
  <message><source>Crops</source><translation>Bestand</translation></message>
  <message><source>Passes and events</source><translation>Überfahrten und Ereignisse</translation></message>
  <message><source>Quality of the data</source><translation>Qualität der Daten</translation></message>
  <message><source>Surface and change</source><translation>Oberfläche und Änderung</translation></message>
  <message><source>The group of {folder} was removed while it was opened.</source><translation>Die Gruppe von {folder} wurde während des Öffnens entfernt.</translation></message>
  <message><source>Worked ground</source><translation>Bearbeiteter Boden</translation></message>
  <message><source>{folder} has no {products} that QGIS can open. Choose the folder of a run.</source><translation>{folder} enthält keine {products}, die QGIS öffnen kann. Den Ordner einer Auswertung wählen.</translation></message>
</context>
<context>
  <name>RunPage</name>
  <message><source>Cancel</source><translation>Abbrechen</translation></message>
  <message><source>Cancelling…</source><translation>Wird abgebrochen …</translation></message>
  <message><source>Elapsed: {time}</source><translation>Vergangen: {time}</translation></message>
</context>
<context>
  <name>SessionLayout</name>
  <message><source>Area</source><translation>Fläche</translation></message>
  <message><source>Depth (approximate)</source><translation>Tiefe (genähert)</translation></message>
  <message><source>Length</source><translation>Länge</translation></message>
  <message><source>Pass</source><translation>Überfahrt</translation></message>
  <message><source>Speed</source><translation>Geschwindigkeit</translation></message>
  <message><source>Time ({zone})</source><translation>Zeit ({zone})</translation></message>
  <message><source>Tool</source><translation>Gerät</translation></message>
  <message><source>Width</source><translation>Breite</translation></message>
  <message><source>pass</source><translation>Überfahrt</translation></message>
  <message><source>unknown</source><translation>unbekannt</translation></message>
  <message><source>▲ north</source><translation>▲ Nord</translation></message>
</context>
<context>
  <name>SessionPage</name>
  <message><source>(missing: drop the recording here)</source><translation>(fehlt: die Aufzeichnung hier ablegen)</translation></message>
  <message><source>A projected CRS in metres, for computation and output.</source><translation>Ein projiziertes KBS in Metern, für Berechnung und Ausgabe.</translation></message>
  <message><source>A recording is missing. Drop it here: the scanner's recording and the receiver's log, from one folder.</source><translation>Eine Aufzeichnung fehlt. Hier ablegen: die Aufzeichnung des Scanners und das Log des Empfängers, aus einem Ordner.</translation></message>
  <message><source>Add another tool</source><translation>Weiteres Gerät hinzufügen</translation></message>
  <message><source>Back</source><translation>Zurück</translation></message>
  <message><source>Boundary</source><translation>Grenze</translation></message>
  <message><source>CRS</source><translation>KBS</translation></message>
  <message><source>Calibrate</source><translation>Kalibrieren</translation></message>
  <message><source>Camera</source><translation>Kamera</translation></message>
  <message><source>Choose a saved machine, or type a name</source><translation>Eine gespeicherte Maschine wählen oder einen Namen eingeben</translation></message>
  <message><source>Choose another folder, then run again.</source><translation>Einen anderen Ordner wählen, dann erneut auswerten.</translation></message>
  <message><source>Choose the map's coordinate reference system.</source><translation>Das Koordinatenbezugssystem der Karte wählen.</translation></message>
  <message><source>Copy the session and its recordings to a folder of this computer.</source><translation>Sitzung und Aufzeichnungen in einen Ordner dieses Rechners kopieren.</translation></message>
  <message><source>Copy to a folder of this computer…</source><translation>In einen Ordner dieses Rechners kopieren …</translation></message>
  <message><source>Depth</source><translation>Tiefe</translation></message>
  <message><source>Drone or helicopter</source><translation>Drohne oder Hubschrauber</translation></message>
  <message><source>Empty: the folder beside the session that is shown in grey.</source><translation>Leer: der grau gezeigte Ordner neben der Sitzung.</translation></message>
  <message><source>Enter the width of the implement, or uncheck 'Implement'.</source><translation>Die Breite des Geräts eintragen oder „Gerät“ abwählen.</translation></message>
  <message><source>Field</source><translation>Feld</translation></message>
  <message><source>Fill in the position and the approximate angles of the scanner first.</source><translation>Zuerst Lage und ungefähre Winkel des Scanners ausfüllen.</translation></message>
  <message><source>Fill in the positions of antenna and scanner first.</source><translation>Zuerst die Lagen von Antenne und Scanner ausfüllen.</translation></message>
  <message><source>Find the scanner's angles in the recording; write them into the session and the chosen machine.</source><translation>Die Winkel des Scanners in der Aufzeichnung finden; sie in die Sitzung und die gewählte Maschine schreiben.</translation></message>
  <message><source>Folder</source><translation>Ordner</translation></message>
  <message><source>GNSS antenna</source><translation>GNSS-Antenne</translation></message>
  <message><source>IMU</source><translation>IMU</translation></message>
  <message><source>Implement</source><translation>Gerät</translation></message>
  <message><source>Keep both</source><translation>Beides behalten</translation></message>
  <message><source>Kind</source><translation>Art</translation></message>
  <message><source>Machine</source><translation>Maschine</translation></message>
  <message><source>Name</source><translation>Name</translation></message>
  <message><source>No machine {name} is saved. Press 'Save as machine' first, or clear the name to calibrate the session alone.</source><translation>Keine Maschine {name} ist gespeichert. Zuerst „Als Maschine speichern“ drücken oder den Namen löschen, um nur die Sitzung zu kalibrieren.</translation></message>
  <message><source>Not known: choose it</source><translation>Nicht bekannt: wählen</translation></message>
  <message><source>Optional: a polygon in the session's folder, to find missed ground.</source><translation>Optional: ein Polygon im Ordner der Sitzung, um ausgelassenen Boden zu finden.</translation></message>
  <message><source>Phase centre of the antenna in the aircraft's frame: forward, left, up. Any point may be the origin of that frame; if it is the antenna, 0, 0, 0. A centimetre is accurate enough. Unchecked: not known.</source><translation>Phasenzentrum der Antenne im System des Fluggeräts: vorn, links, oben. Jeder Punkt kann dessen Ursprung sein; ist es die Antenne: 0, 0, 0. Ein Zentimeter ist genau genug. Abgewählt: nicht bekannt.</translation></message>
  <message><source>Phase centre of the antenna, from the point on the ground below the middle of the rear axle: forward, left, up. A centimetre is accurate enough. Unchecked: not known.</source><translation>Phasenzentrum der Antenne vom Punkt am Boden unter der Mitte der Hinterachse aus: vorn, links, oben. Ein Zentimeter ist genau genug. Abgewählt: nicht bekannt.</translation></message>
  <message><source>Polygons (*.geojson *.gpkg *.shp *.kml)</source><translation>Polygone (*.geojson *.gpkg *.shp *.kml)</translation></message>
  <message><source>Position in the same frame, and rotation of the scanner's axes from forward, left, up; its spin axis is z. One that sweeps across the track has about -90, 0, -90. The run refines the angles; within 2° is accurate enough.</source><translation>Lage im selben System und Drehung der Scannerachsen gegen vorn, links, oben; seine Drehachse ist z. Einer, der quer zur Bahn abtastet, hat etwa -90, 0, -90. Die Auswertung verfeinert die Winkel; auf 2° ist genau genug.</translation></message>
  <message><source>Position, and rotation from level with the cable to the rear. A scanner that faces backwards and is tilted down has about 0, 40, 180. The run refines the angles; within 2° is accurate enough.</source><translation>Lage und Drehung gegen waagerecht mit dem Kabel nach hinten. Ein nach hinten blickender, nach unten geneigter Scanner hat etwa 0, 40, 180. Die Auswertung verfeinert die Winkel; auf 2° ist genau genug.</translation></message>
  <message><source>Preview</source><translation>Vorschau</translation></message>
  <message><source>Recordings</source><translation>Aufzeichnungen</translation></message>
  <message><source>Replace its places by those of the form, or type another name.</source><translation>Ihre Lagen durch die des Formulars ersetzen oder einen anderen Namen eingeben.</translation></message>
  <message><source>Replace the machine</source><translation>Die Maschine ersetzen</translation></message>
  <message><source>Replace them</source><translation>Sie ersetzen</translation></message>
  <message><source>Results</source><translation>Ergebnisse</translation></message>
  <message><source>Run without accuracy</source><translation>Ohne Genauigkeit auswerten</translation></message>
  <message><source>Save</source><translation>Speichern</translation></message>
  <message><source>Save and run</source><translation>Speichern und auswerten</translation></message>
  <message><source>Save as machine</source><translation>Als Maschine speichern</translation></message>
  <message><source>Scanner</source><translation>Scanner</translation></message>
  <message><source>Scanners of this session: {}. Shown here is the first; the others stay as they are.</source><translation>Scanner dieser Sitzung: {}. Hier ist der erste gezeigt; die anderen bleiben, wie sie sind.</translation></message>
  <message><source>Session</source><translation>Sitzung</translation></message>
  <message><source>The machine {name} cannot be read.</source><translation>Die Maschine {name} ist nicht lesbar.</translation></message>
  <message><source>Tractor or other ground vehicle</source><translation>Traktor oder anderes Bodenfahrzeug</translation></message>
  <message><source>Type a name for the machine.</source><translation>Einen Namen für die Maschine eingeben.</translation></message>
  <message><source>Vehicle</source><translation>Fahrzeug</translation></message>
  <message><source>Width</source><translation>Breite</translation></message>
  <message><source>Working width, and the middle of the working line relative to the rear axle; x is negative behind it. Depth 0 means unknown. Unchecked: no worked ground is computed.</source><translation>Arbeitsbreite und die Mitte der Arbeitslinie gegenüber der Hinterachse; dahinter ist x negativ. Tiefe 0 bedeutet unbekannt. Abgewählt: Es wird kein bearbeiteter Boden berechnet.</translation></message>
  <message><source>roll, pitch, yaw</source><translation>Roll, Pitch, Gier</translation></message>
  <message><source>tool {number}</source><translation>Gerät {number}</translation></message>
  <message><source>x, y</source><translation>x, y</translation></message>
  <message><source>x, y, z</source><translation>x, y, z</translation></message>
  <message><source>{path} cannot be written: {reason}.</source><translation>{path} lässt sich nicht schreiben: {reason}.</translation></message>
  <message><source>{title}: not filled in</source><translation>{title}: nicht ausgefüllt</translation></message>
</context>
<context>
  <name>Stages</name>
  <message><source>adjusting images</source><translation>Bilder ausgleichen</translation></message>
  <message><source>cleaning clouds</source><translation>Punktwolken bereinigen</translation></message>
  <message><source>exporting</source><translation>Exportieren</translation></message>
  <message><source>filling gaps</source><translation>Lücken füllen</translation></message>
  <message><source>finding features</source><translation>Merkmale suchen</translation></message>
  <message><source>hashing inputs</source><translation>Prüfsummen der Eingaben</translation></message>
  <message><source>looking at control points</source><translation>Passpunkte ansehen</translation></message>
  <message><source>looking at scans</source><translation>Scans ansehen</translation></message>
  <message><source>looking for noise</source><translation>Rauschen suchen</translation></message>
  <message><source>looking for the board</source><translation>Tafel suchen</translation></message>
  <message><source>making surfaces</source><translation>Oberflächen erzeugen</translation></message>
  <message><source>matching images</source><translation>Bilder zuordnen</translation></message>
  <message><source>matching scans</source><translation>Scans zuordnen</translation></message>
  <message><source>measuring density</source><translation>Dichte messen</translation></message>
  <message><source>placing points</source><translation>Punkte verorten</translation></message>
  <message><source>reading clouds</source><translation>Punktwolken lesen</translation></message>
  <message><source>reading images</source><translation>Bilder lesen</translation></message>
  <message><source>reading positions</source><translation>Positionen lesen</translation></message>
  <message><source>reading results</source><translation>Ergebnisse lesen</translation></message>
  <message><source>reading scans</source><translation>Scans lesen</translation></message>
  <message><source>waiting for another process</source><translation>Warten auf einen anderen Prozess</translation></message>
  <message><source>work</source><translation>Arbeit</translation></message>
  <message><source>writing cloud</source><translation>Punktwolke schreiben</translation></message>
  <message><source>writing layers</source><translation>Ebenen schreiben</translation></message>
  <message><source>writing the farm map</source><translation>Betriebskarte schreiben</translation></message>
  <message><source>writing the mosaic</source><translation>Mosaik schreiben</translation></message>
  <message><source>writing the page</source><translation>Seite schreiben</translation></message>
  <message><source>writing the preview</source><translation>Vorschau schreiben</translation></message>
  <message><source>writing the project</source><translation>Projekt schreiben</translation></message>
</context>
<context>
  <name>StartPage</name>
  <message><source>Choose a folder for the results…</source><translation>Einen Ordner für die Ergebnisse wählen …</translation></message>
  <message><source>Choose recordings or a session…</source><translation>Aufzeichnungen oder eine Sitzung wählen …</translation></message>
  <message><source>Copy to a folder of this computer…</source><translation>In einen Ordner dieses Rechners kopieren …</translation></message>
  <message><source>Drop here:
recordings of a drive,
their folder, a session.toml,
a machine or the folder of a run.
Several sessions or folders run one after another.</source><translation>Hier ablegen:
Aufzeichnungen einer Fahrt,
ihr Ordner, eine session.toml,
eine Maschine oder der Ordner einer Auswertung.
Mehrere Sitzungen oder Ordner laufen nacheinander.</translation></message>
  <message><source>Existing results can be opened at once. To run sessions, set up furrowmap's worker: a separate Python environment. QGIS's Python is not changed.</source><translation>Vorhandene Ergebnisse lassen sich sofort öffnen. Zum Auswerten von Sitzungen den Arbeitsprozess von furrowmap einrichten: eine eigene Python-Umgebung. Das Python von QGIS wird nicht geändert.</translation></message>
  <message><source>Folder that 'furrowmap run' wrote</source><translation>Ordner, den „furrowmap run“ geschrieben hat</translation></message>
  <message><source>Open the folder of a run…</source><translation>Den Ordner einer Auswertung öffnen …</translation></message>
  <message><source>Recent sessions</source><translation>Letzte Sitzungen</translation></message>
  <message><source>Recordings of one drive, or a session</source><translation>Aufzeichnungen einer Fahrt oder eine Sitzung</translation></message>
  <message><source>Run it as it is</source><translation>Auswerten, wie sie ist</translation></message>
  <message><source>Set up…</source><translation>Einrichten …</translation></message>
  <message><source>The last list of {count} drives…</source><translation>Die letzte Liste mit {count} Fahrten …</translation></message>
</context>
<context>
  <name>VehicleView</name>
  <message><source>Above: from the right side. Below: from the top. The origin is on the ground below the middle of the rear axle. Grey: a compact tractor for comparison. Blue lines: the scan plane.</source><translation>Oben: von der rechten Seite. Unten: von oben. Der Ursprung liegt am Boden unter der Mitte der Hinterachse. Grau: ein Kompakttraktor zum Vergleich. Blaue Linien: die Scanebene.</translation></message>
  <message><source>Above: from the right side. Below: from the top; the nose is on the right. Grey: a drone for comparison, with the origin on top of it. Blue lines: the scan plane.</source><translation>Oben: von der rechten Seite. Unten: von oben; die Nase ist rechts. Grau: eine Drohne zum Vergleich, mit dem Ursprung auf ihrer Oberseite. Blaue Linien: die Scanebene.</translation></message>
  <message><source>IMU</source><translation>IMU</translation></message>
  <message><source>antenna</source><translation>Antenne</translation></message>
  <message><source>camera</source><translation>Kamera</translation></message>
  <message><source>implement</source><translation>Gerät</translation></message>
  <message><source>scanner</source><translation>Scanner</translation></message>
  <message><source>side</source><translation>Seite</translation></message>
  <message><source>top</source><translation>oben</translation></message>
</context>
<context>
  <name>Worker</name>
  <message><source>A line of output was too long and was dropped.</source><translation>Eine Ausgabezeile war zu lang und wurde verworfen.</translation></message>
  <message><source>Cancelled.</source><translation>Abgebrochen.</translation></message>
  <message><source>Choose or create an environment in Settings › Options › furrowmap.</source><translation>Eine Umgebung unter Einstellungen › Optionen › furrowmap wählen oder anlegen.</translation></message>
  <message><source>It was ended. Products of an earlier run are unchanged.</source><translation>Er wurde beendet. Produkte einer früheren Auswertung sind unverändert.</translation></message>
  <message><source>It wrote no output.</source><translation>Er schrieb keine Ausgabe.</translation></message>
  <message><source>It wrote no output; the computer may be out of memory.</source><translation>Er schrieb keine Ausgabe; dem Rechner fehlt womöglich Arbeitsspeicher.</translation></message>
  <message><source>No partial files are left.</source><translation>Es bleiben keine unvollständigen Dateien zurück.</translation></message>
  <message><source>Nothing was run.</source><translation>Es wurde nichts ausgewertet.</translation></message>
  <message><source>See its last lines in the log. Products of an earlier run are unchanged.</source><translation>Seine letzten Zeilen stehen im Protokoll. Produkte einer früheren Auswertung sind unverändert.</translation></message>
  <message><source>Sessions cannot be run; existing results can still be opened.</source><translation>Sitzungen lassen sich nicht auswerten; vorhandene Ergebnisse lassen sich weiterhin öffnen.</translation></message>
  <message><source>Test it in Settings › Options › furrowmap.</source><translation>Ihn unter Einstellungen › Optionen › furrowmap prüfen.</translation></message>
  <message><source>The run failed; see the log.</source><translation>Die Auswertung schlug fehl; siehe Protokoll.</translation></message>
  <message><source>The worker ended without an answer (status {status}, at: {stage}).</source><translation>Der Arbeitsprozess endete ohne Antwort (Status {status}, bei: {stage}).</translation></message>
  <message><source>The worker sent nothing for {minutes:.0f} minutes (at: {stage}).</source><translation>Der Arbeitsprozess sendete {minutes:.0f} Minuten lang nichts (bei: {stage}).</translation></message>
  <message><source>Try again without the file that it was reading, or inspect that file first.</source><translation>Erneut ohne die Datei versuchen, die er gerade las, oder diese zuerst untersuchen.</translation></message>
  <message><source>Update the older one: the plugin in QGIS's plugin manager, or furrowmap in its environment.</source><translation>Den älteren Teil aktualisieren: das Plugin in der Erweiterungsverwaltung von QGIS oder furrowmap in seiner Umgebung.</translation></message>
  <message><source>furrowmap {version} has protocol version {found}; this plugin needs version {own}.</source><translation>furrowmap {version} hat die Protokollversion {found}; dieses Plugin braucht Version {own}.</translation></message>
  <message><source>the start</source><translation>dem Beginn</translation></message>
  <message><source>{program} could not be started: {reason}.</source><translation>{program} ließ sich nicht starten: {reason}.</translation></message>
  <message><source>{program} did not answer within {seconds:.0f} s.</source><translation>{program} antwortete nicht innerhalb von {seconds:.0f} s.</translation></message>
</context>
</TS>
