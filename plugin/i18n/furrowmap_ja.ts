<?xml version="1.0" encoding="utf-8"?>
<!DOCTYPE TS>
<TS version="2.1" language="ja">
<context>
  <name>Algorithms</name>
  <message>
    <source>A .tif or .vrt file.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>A COPC file; its name ends in .copc.laz.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>A connection URI such as postgresql://me@server/farm, instead of a GeoPackage. Keep passwords in PostgreSQL's password file.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Accuracy</source>
    <translation>精度</translation>
  </message>
  <message>
    <source>Add results to the farm map</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Adds the results of runs to a farm map, a GeoPackage or a PostGIS database, which is created if it does not exist. Sessions that the farm map contains are replaced by the new result. If one of them fails, nothing is changed.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Adds them to the project when the algorithm has finished.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>All other lines of the file stay as they are.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Another log of the same drive, or a trajectory.</source>
    <translation>同じ走行の別のログ、または軌跡。</translation>
  </message>
  <message>
    <source>Antenna offset (m)</source>
    <translation>アンテナのオフセット（m）</translation>
  </message>
  <message>
    <source>By default 1.5 times the interval of the reference.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>By default a projected CRS that fits the location.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>By default all layers.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>By default beside the results. Formats with one layer per file need a folder.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>By default session.toml beside the recordings.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>By default the CRS of the first session.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>By default the CRS of the session.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>By default the CRS of the surfaces.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>By default the cell size of the surfaces.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>CRS of a new farm map</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>CRS of clouds without one</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>CRS of the clean point cloud</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>CRS of the mosaic</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>CRS of the output</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>CRS of the points</source>
    <translation>測量点の CRS</translation>
  </message>
  <message>
    <source>CRS of the surfaces</source>
    <translation>サーフェスの CRS</translation>
  </message>
  <message>
    <source>CRS of the vectors</source>
    <translation>ベクタの CRS</translation>
  </message>
  <message>
    <source>CSV or GeoPackage.</source>
    <translation>CSV または GeoPackage。</translation>
  </message>
  <message>
    <source>Calibrate the mounting</source>
    <translation>取り付けのキャリブレーション</translation>
  </message>
  <message>
    <source>Cancelled; no partial files are left.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Captures, bags, GNSS logs, trajectories, point clouds.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Cell size</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Cell statistic</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Check against surveyed points</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Class codes, separated by commas, such as 2,9. 64,65 is the machine in clouds of furrowmap.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Class codes, separated by commas, such as 2,9. By default all but noise.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Classes to leave out</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Classes to use</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Clean point cloud</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Clean point clouds</source>
    <translation>点群を整える</translation>
  </message>
  <message>
    <source>Combines the surfaces of a farm map's sessions into one raster. Where they overlap, the latest session is used. A .vrt is a small file that refers to the surfaces; a .tif is a cloud-optimised GeoTIFF with all bands.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Compares a point cloud or a surface with surveyed points. The RMSE follows the ASPRS Positional Accuracy Standards, Edition 2 (2023), and includes the accuracy of the points.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Compares the positions of a GNSS log with a reference at the same epochs: mean, standard deviation and RMSE in 3D, 2D, X, Y and Z, for all epochs and by fix type.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Computes rasters from LAS, LAZ or COPC point clouds of any source: surface model (DSM), terrain model (DTM), height above ground, hillshade, slope, roughness, and low spots that hold water. Memory use does not depend on the size of the area.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Computes the georeferenced point cloud of a session's recording, detects in the scans when the implement is in the ground, and writes the worked ground, surfaces and a report.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Computes the ground that a machine worked in each field from its ISO 11783-10 task data, without a scanner: passes, overlaps, missed strips and their areas.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Converts the results of a run: GeoPackage, GeoParquet, FlatGeobuf, GeoJSON, Shapefile, KML, CSV, ISO 11783-10 task data for farm software and terminals, or a STAC catalogue of many runs. GeoJSON and KML are always in WGS 84.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Coordinate transformations of a session</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Create a session file</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Data exchange</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Date of the first position</source>
    <translation>最初の測位の日付</translation>
  </message>
  <message>
    <source>Diameter of the discs</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Direction of tillage</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Direction of tillage, clockwise from grid north: random roughness is then told without its marks.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Disc targets</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Epochs of the reference</source>
    <translation>基準のエポック</translation>
  </message>
  <message>
    <source>Estimates the scanner's mounting and the offset between its clock and the GNSS receiver's from the recording: on average the ground is level, and ground scanned twice coincides.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Evaluate a GNSS log</source>
    <translation>GNSS ログの評価</translation>
  </message>
  <message>
    <source>Evaluation (HTML)</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Every n-th point</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Export results</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Extent</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Farm map</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Farm map (GeoPackage)</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Farm map (PostGIS)</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Field, drive and sensors. By default a small field that is tilled for a minute.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Figures by field (JSON)</source>
    <translation>圃場ごとの集計（JSON）</translation>
  </message>
  <message>
    <source>File or folder written</source>
    <translation>書き出したファイルまたはフォルダ</translation>
  </message>
  <message>
    <source>Files written</source>
    <translation>書き出したファイル</translation>
  </message>
  <message>
    <source>Fill gaps up to so far from seen heights, nothing outside.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Findings (JSON)</source>
    <translation>調査結果（JSON）</translation>
  </message>
  <message>
    <source>For cloud-optimised GeoTIFFs and surfaces.json.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>For evaluation.json, an HTML page and a table of epochs.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>For recording, session file and ground truth.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>For the dates of sessions, such as Asia/Tokyo. By default by longitude.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Format</source>
    <translation>形式</translation>
  </message>
  <message>
    <source>Forward, left, up: from the antenna of the reference to that of the log, on the same vehicle.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Found in the recordings</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Give either '{one}' or '{other}'.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Ground classification</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>How ground is told, class 2; all but noise and furrowmap's machine is then class 1. none: classes stay.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>How ground is told; auto: by the clouds' own classes where they have them, else smrf.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>How points that are alone are told, and left out.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>How points that are alone are told; they become noise, class 7.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Inspect recordings</source>
    <translation>記録を調べる</translation>
  </message>
  <message>
    <source>Instead of the latest session.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Known point</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>LAS, LAZ or COPC files in one CRS.</source>
    <translation>同じ座標参照系の LAS、LAZ、COPC ファイル。</translation>
  </message>
  <message>
    <source>LAS, LAZ or COPC files; all go into one raster grid.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>LAS, LAZ, COPC or GeoTIFF.</source>
    <translation>LAS、LAZ、COPC、または GeoTIFF。</translation>
  </message>
  <message>
    <source>Layers</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Leave noise out, classes 7 and 18 of the clouds as well.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Leave out noise</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>LiDAR captures or bags, GNSS logs and trajectories of one drive.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>List the sessions of the farm map</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Lists the sessions of a farm map: identifier, date, worked area, name.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Log to evaluate</source>
    <translation>評価するログ</translation>
  </message>
  <message>
    <source>Look for discs around the points, by this, for the horizontal error.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Maximum gap to fill</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Maximum interpolation gap</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Mean of all sessions</source>
    <translation>全セッションの平均</translation>
  </message>
  <message>
    <source>Missing from the recordings</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Mosaic</source>
    <translation>モザイク</translation>
  </message>
  <message>
    <source>Mosaic of the farm map's surfaces</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>NMEA, or another log that 'Inspect recordings' reads.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Number of points</source>
    <translation>点の数</translation>
  </message>
  <message>
    <source>Number of sessions</source>
    <translation>セッションの数</translation>
  </message>
  <message>
    <source>Number of sessions left</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Number of sessions removed</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Number of surfaces</source>
    <translation>サーフェスの数</translation>
  </message>
  <message>
    <source>Of a static antenna, instead of a log: latitude, longitude, height, separated by commas.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>On the command line:</source>
    <translation>コマンドライン：</translation>
  </message>
  <message>
    <source>One per line: the identifier, the beginning of it, or the name.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>One row per point.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Only points within this extent.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Only the task of that id or name.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Open the products as styled layers</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Otherwise the algorithm stops if the output exists.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Otherwise they are transformed.</source>
    <translation>指定しない場合は座標変換します。</translation>
  </message>
  <message>
    <source>Outlier detection method</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Output file or folder</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Output folder</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Overwrite existing files</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Overwrite the products of another session</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Passes, overlaps and missed strips of all fields.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Point cloud or surface</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Point clouds</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>PostGIS schema</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Preview only</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Products of the same session in it are replaced.</source>
    <translation>同じセッションの成果物は置き換えられます。</translation>
  </message>
  <message>
    <source>Reads recordings and writes a commented session.toml with everything that they contain. What they do not contain, such as the mounting of the scanner, is left as a comment and reported.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Recordings</source>
    <translation>記録</translation>
  </message>
  <message>
    <source>Reference log</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Refuse sessions in another CRS</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Remove sessions from the farm map</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Removes sessions from a farm map. The folders of their results are not touched.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Replace the products of another session in that folder.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Report (HTML)</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Reports what a run would do with the coordinates of a session, with figures for the site: reference frame and epoch, size of the shift, geoid height, grid convergence and scale factor. Nothing is written.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Reports what recordings contain: sensor model, points, time span, clocks and their differences, fix types.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Required horizontal RMSE</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Required vertical RMSE</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Requirements met</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Results of runs</source>
    <translation>実行結果</translation>
  </message>
  <message>
    <source>Run a session</source>
    <translation>セッションの実行</translation>
  </message>
  <message>
    <source>Scenario</source>
    <translation>シナリオ</translation>
  </message>
  <message>
    <source>Schema of the tables in the database.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Session file</source>
    <translation>セッションファイル</translation>
  </message>
  <message>
    <source>Session file written</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Sessions</source>
    <translation>セッション</translation>
  </message>
  <message>
    <source>Sessions (JSON)</source>
    <translation>セッション（JSON）</translation>
  </message>
  <message>
    <source>Side of a cell [default: the least round one with four points in it].</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Simulate a recording</source>
    <translation>記録のシミュレーション</translation>
  </message>
  <message>
    <source>Standard deviation of the survey</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Surface</source>
    <translation>サーフェス</translation>
  </message>
  <message>
    <source>Surfaces and point clouds</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Surfaces from point clouds</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Surveyed points</source>
    <translation>測量点</translation>
  </message>
  <message>
    <source>TASKDATA.XML in its folder, or a .zip of the folder.</source>
    <translation>フォルダの中の TASKDATA.XML、またはそのフォルダの .zip。</translation>
  </message>
  <message>
    <source>Table of errors</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Take one point of each cube of this side, the one nearest to its middle.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Takes seconds: the trajectory and a coarse surface of few scans, without scan matching or detection of the implement. The products of a run are not replaced.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Task</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Task data</source>
    <translation>作業データ</translation>
  </message>
  <message>
    <source>The CRS of the cloud, in metres [default: that of the clouds].</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>The CRS of the points, and of a cloud, where their files state none [default: the product's].</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>The CRS of the surfaces, in metres [default: that of the clouds].</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>The farm's GeoPackage.</source>
    <translation>農場の GeoPackage。</translation>
  </message>
  <message>
    <source>The output MET says whether it is met.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>The report.json of each run; it stands for the folder of the run.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>The session.toml beside the recording.</source>
    <translation>記録の隣にある session.toml。</translation>
  </message>
  <message>
    <source>The session.toml beside the recording; 'Create a session file' writes one.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>The survey's own standard deviation on each axis.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Time zone</source>
    <translation>タイムゾーン</translation>
  </message>
  <message>
    <source>UTC, as YYYY-MM-DD; for logs without dates.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Used for point clouds whose header has no CRS. Others keep their own.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Used only with disc targets.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Values above 1 give a quick look.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Voxel size</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>What stands for the points of a cell: median, trimmed, mean, min, max, or a percentile such as p90.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Worked ground</source>
    <translation>作業した範囲</translation>
  </message>
  <message>
    <source>Worked ground from task data (ISOXML)</source>
    <translation>作業データ（ISOXML）から作業した範囲</translation>
  </message>
  <message>
    <source>Working width</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Working width [default: the widest that the logs show].</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Write the results into the session file</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Writes a simulated tractor recording: LiDAR packets, a GNSS log, a session file and the field boundary, with the ground truth. Useful to learn furrowmap and to plan a sensor mount.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>Writes one COPC file from LAS, LAZ or COPC point clouds of any source: outliers become noise, ground is classified, and the cloud is thinned, each if asked for. Memory use does not depend on the size of the area.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>dsm: after the work; dsm_before: before it; change: the difference.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>fixed: leave out epochs at which the reference has no RTK fix.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>furrowmap's worker is not set up. Choose or create its environment in Settings › Options › furrowmap.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>isoxml writes task data into a folder, or into a .zip if the output's name ends in .zip. Only stac accepts several results.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>{parameter}: '{text}' is not a list of {count} numbers separated by commas.</source>
    <translation type="unfinished"/>
  </message>
  <message>
    <source>{parameter}: {path} does not exist.</source>
    <translation type="unfinished"/>
  </message>
</context>
<context>
  <name>BaseMap</name>
  <message>
    <source>'{own}' is no base map: give a URL with {{z}}, {{x}} and {{y}}, one with {{TileMatrix}}, {{TileRow}} and {{TileCol}}, or an MBTiles file.</source>
    <translation>「{own}」はベースマップとして使えません。{{z}}、{{x}}、{{y}} を含む URL、{{TileMatrix}}、{{TileRow}}、{{TileCol}} を含む URL、または MBTiles ファイルを指定してください。</translation>
  </message>
  <message>
    <source>GSI aerial photo</source>
    <translation>地理院タイル（写真）</translation>
  </message>
  <message>
    <source>GSI standard map</source>
    <translation>地理院タイル（標準地図）</translation>
  </message>
  <message>
    <source>Geospatial Information Authority of Japan (GSI) tiles</source>
    <translation>国土地理院（GSI）タイル</translation>
  </message>
  <message>
    <source>Own base map</source>
    <translation>独自のベースマップ</translation>
  </message>
  <message>
    <source>© OpenStreetMap contributors</source>
    <translation>© OpenStreetMap contributors</translation>
  </message>
</context>
<context>
  <name>BaseMapChooser</name>
  <message>
    <source>Base map</source>
    <translation>ベースマップ</translation>
  </message>
  <message>
    <source>URL of XYZ tiles or of a RESTful WMTS in Web Mercator, or the path of an MBTiles file</source>
    <translation>Web メルカトルの XYZ タイルか RESTful WMTS の URL、または MBTiles ファイルのパス</translation>
  </message>
  <message>
    <source>none (offline)</source>
    <translation>なし（オフライン）</translation>
  </message>
  <message>
    <source>own tiles or file…</source>
    <translation>独自のタイルまたはファイル…</translation>
  </message>
</context>
<context>
  <name>Classes</name>
  <message>
    <source>ground</source>
    <translation>地面</translation>
  </message>
  <message>
    <source>implement</source>
    <translation>作業機</translation>
  </message>
  <message>
    <source>noise</source>
    <translation>ノイズ</translation>
  </message>
  <message>
    <source>other</source>
    <translation>その他</translation>
  </message>
  <message>
    <source>vehicle</source>
    <translation>車両</translation>
  </message>
</context>
<context>
  <name>Figures</name>
  <message>
    <source>Accuracy across the ground</source>
    <translation>水平の精度</translation>
  </message>
  <message>
    <source>Accuracy of heading</source>
    <translation>方位の精度</translation>
  </message>
  <message>
    <source>Accuracy of heights</source>
    <translation>高さの精度</translation>
  </message>
  <message>
    <source>Begun</source>
    <translation>開始</translation>
  </message>
  <message>
    <source>CRS</source>
    <translation>CRS</translation>
  </message>
  <message>
    <source>Duration</source>
    <translation>所要時間</translation>
  </message>
  <message>
    <source>Missed</source>
    <translation>作業残し</translation>
  </message>
  <message>
    <source>Passes</source>
    <translation>行程</translation>
  </message>
  <message>
    <source>Points</source>
    <translation>点数</translation>
  </message>
  <message>
    <source>Way driven</source>
    <translation>走行距離</translation>
  </message>
  <message>
    <source>Worked</source>
    <translation>作業面積</translation>
  </message>
  <message>
    <source>Worked twice</source>
    <translation>重複作業</translation>
  </message>
</context>
<context>
  <name>Findings</name>
  <message>
    <source>CRS: no recording tells where it was made.</source>
    <translation>CRS：どの記録からも場所が分かりません。</translation>
  </message>
  <message>
    <source>Found out</source>
    <translation>分かったこと</translation>
  </message>
  <message>
    <source>GNSS antenna: where it is. Until then it counts as on the ground below the rear axle.</source>
    <translation>GNSS アンテナ：取付位置。記入するまでは、後車軸の真下の地面にあるものとして扱います。</translation>
  </message>
  <message>
    <source>Scanner: where it is and how it is turned. Until then there is no surface worth the name.</source>
    <translation>スキャナ：取付位置と向き。記入するまでは、意味のある地表面は得られません。</translation>
  </message>
  <message>
    <source>The receiver's log: drop it together with the scanner's recording.</source>
    <translation>受信機のログ：スキャナの記録と一緒にドロップしてください。</translation>
  </message>
  <message>
    <source>The scanner's recording: drop it together with the receiver's log.</source>
    <translation>スキャナの記録：受信機のログと一緒にドロップしてください。</translation>
  </message>
  <message>
    <source>To be filled in</source>
    <translation>記入が必要な項目</translation>
  </message>
  <message>
    <source>Tool: how wide it is and where. Until then no ground worked is computed.</source>
    <translation>作業機：幅と位置。記入するまでは、作業済みの地面は計算されません。</translation>
  </message>
</context>
<context>
  <name>FurrowmapDock</name>
  <message>
    <source>Add the session to the map first.</source>
    <translation>先にセッションを地図に追加してください。</translation>
  </message>
  <message>
    <source>Line {number} of {name} is more than this form edits, so the session was taken as it is.</source>
    <translation>{name} の {number} 行目はこのフォームでは編集できないため、セッションをそのまま使いました。</translation>
  </message>
  <message>
    <source>Log</source>
    <translation>ログ</translation>
  </message>
  <message>
    <source>Looking at the recordings</source>
    <translation>記録を調べています</translation>
  </message>
  <message>
    <source>Running {name}</source>
    <translation>{name} を実行中</translation>
  </message>
  <message>
    <source>Saved {path}</source>
    <translation>{path} を保存しました</translation>
  </message>
  <message>
    <source>Stopped; nothing half-written is left.</source>
    <translation>止めました。書きかけのものは残っていません。</translation>
  </message>
  <message>
    <source>The run failed; the log tells more.</source>
    <translation>実行に失敗しました。詳しくはログをご覧ください。</translation>
  </message>
  <message>
    <source>The work before is being stopped; try again in a moment.</source>
    <translation>前の処理を止めています。少し待ってからやり直してください。</translation>
  </message>
  <message>
    <source>These recordings have a session already: here it is.</source>
    <translation>この記録にはすでにセッションがあります。それを開きました。</translation>
  </message>
  <message>
    <source>To compute, furrowmap's worker has to be set up first; results can be opened without it.</source>
    <translation>計算するには、まず furrowmap のワーカーを設定してください。結果は設定しなくても開けます。</translation>
  </message>
  <message>
    <source>Work is under way. Wait for its end, or cancel it first.</source>
    <translation>処理中です。終わるのを待つか、先に取り消してください。</translation>
  </message>
  <message>
    <source>furrowmap: looking at recordings</source>
    <translation>furrowmap：記録を調べています</translation>
  </message>
  <message>
    <source>{path} cannot be read: {reason}.</source>
    <translation>{path} を読めません：{reason}。</translation>
  </message>
  <message>
    <source>{path} is not there.</source>
    <translation>{path} がありません。</translation>
  </message>
</context>
<context>
  <name>FurrowmapPlugin</name>
  <message>
    <source>furrowmap</source>
    <translation>furrowmap</translation>
  </message>
</context>
<context>
  <name>Interpreter</name>
  <message>
    <source>Chosen below.</source>
    <translation>下で選ばれたものです。</translation>
  </message>
  <message>
    <source>Found on the search path for programs.</source>
    <translation>プログラムの検索パスで見つかりました。</translation>
  </message>
  <message>
    <source>It installed this plugin by 'furrowmap qgis install'.</source>
    <translation>'furrowmap qgis install' でこのプラグインを入れたものです。</translation>
  </message>
  <message>
    <source>None was found. Results of others can be opened; to compute your own, choose or make one.</source>
    <translation>見つかりません。ほかの人の結果は開けます。自分で計算するには、選ぶか作ってください。</translation>
  </message>
  <message>
    <source>This plugin made it.</source>
    <translation>このプラグインが作りました。</translation>
  </message>
</context>
<context>
  <name>Legends</name>
  <message>
    <source>PPP</source>
    <translation>PPP</translation>
  </message>
  <message>
    <source>RTK fixed</source>
    <translation>RTK FIX</translation>
  </message>
  <message>
    <source>RTK float</source>
    <translation>RTK FLOAT</translation>
  </message>
  <message>
    <source>Relief as left at the end</source>
    <translation>作業後の起伏</translation>
  </message>
  <message>
    <source>Relief before the work</source>
    <translation>作業前の起伏</translation>
  </message>
  <message>
    <source>Soil sunk or risen (m)</source>
    <translation>土の沈下・隆起（m）</translation>
  </message>
  <message>
    <source>Swaths apart in height (m)</source>
    <translation>走査帯どうしの高さの差（m）</translation>
  </message>
  <message>
    <source>body of the field</source>
    <translation>圃場の本体</translation>
  </message>
  <message>
    <source>differential</source>
    <translation>ディファレンシャル</translation>
  </message>
  <message>
    <source>drives backwards</source>
    <translation>後退</translation>
  </message>
  <message>
    <source>drives forward</source>
    <translation>前進</translation>
  </message>
  <message>
    <source>headland</source>
    <translation>枕地</translation>
  </message>
  <message>
    <source>missed along the boundary</source>
    <translation>境界沿いの作業残し</translation>
  </message>
  <message>
    <source>missed between passes</source>
    <translation>行程間の作業残し</translation>
  </message>
  <message>
    <source>other</source>
    <translation>その他</translation>
  </message>
  <message>
    <source>other, or from a file</source>
    <translation>その他、またはファイルから</translation>
  </message>
  <message>
    <source>positions end</source>
    <translation>測位の途切れ</translation>
  </message>
  <message>
    <source>single</source>
    <translation>単独測位</translation>
  </message>
  <message>
    <source>stop</source>
    <translation>停止</translation>
  </message>
  <message>
    <source>tool down</source>
    <translation>作業機 下</translation>
  </message>
  <message>
    <source>tool lifted</source>
    <translation>作業機を上げた</translation>
  </message>
  <message>
    <source>tool lowered</source>
    <translation>作業機を下ろした</translation>
  </message>
  <message>
    <source>tool up</source>
    <translation>作業機 上</translation>
  </message>
  <message>
    <source>unknown</source>
    <translation>不明</translation>
  </message>
</context>
<context>
  <name>Making</name>
  <message>
    <source>Check the network, or install from a folder of wheels. The log above tells more.</source>
    <translation>ネットワークを確かめるか、wheel のフォルダから入れてください。詳しくは上のログにあります。</translation>
  </message>
  <message>
    <source>Install Python from python.org; on Debian and Ubuntu the package python3-venv. Then try again.</source>
    <translation>python.org から Python を入れてください（Debian、Ubuntu では python3-venv パッケージ）。そのあとやり直してください。</translation>
  </message>
  <message>
    <source>Nothing half-made is left; an environment that was there is as it was.</source>
    <translation>作りかけのものは残っていません。以前の環境があれば元のままです。</translation>
  </message>
  <message>
    <source>The environment could not be made: {reason}</source>
    <translation>環境を作れませんでした：{reason}</translation>
  </message>
  <message>
    <source>The folder of wheels has to hold furrowmap {version} and all that it needs.</source>
    <translation>wheel のフォルダには furrowmap {version} と、それに必要なものすべてが要ります。</translation>
  </message>
  <message>
    <source>There is no Python {version} or newer that can make environments.</source>
    <translation>環境を作れる Python {version} 以降がありません。</translation>
  </message>
  <message>
    <source>furrowmap's worker needs one of its own, beside QGIS.</source>
    <translation>furrowmap のワーカーには、QGIS とは別の Python が要ります。</translation>
  </message>
  <message>
    <source>{program} is not furrowmap.</source>
    <translation>{program} は furrowmap ではありません。</translation>
  </message>
</context>
<context>
  <name>Options</name>
  <message>
    <source>A Python environment for furrowmap will be made in {folder}. QGIS's own Python stays as it is. Go on?</source>
    <translation>furrowmap 用の Python 環境を {folder} に作ります。QGIS 自身の Python は変わりません。続けますか？</translation>
  </message>
  <message>
    <source>An environment of its own</source>
    <translation>専用の環境</translation>
  </message>
  <message>
    <source>Another one (a Python interpreter with furrowmap, or the command itself):</source>
    <translation>別のもの（furrowmap の入った Python インタプリタ、または furrowmap コマンド）：</translation>
  </message>
  <message>
    <source>Check</source>
    <translation>確認</translation>
  </message>
  <message>
    <source>Checking furrowmap</source>
    <translation>furrowmap を確認しています</translation>
  </message>
  <message>
    <source>Choose the folder that holds the wheels.</source>
    <translation>wheel のあるフォルダを選んでください。</translation>
  </message>
  <message>
    <source>Found by itself</source>
    <translation>自動で探す</translation>
  </message>
  <message>
    <source>From a folder of wheels (no network; 920 MB on the disk)</source>
    <translation>wheel のフォルダから（ネットワーク不要、ディスク：920 MB）</translation>
  </message>
  <message>
    <source>From the package index (network: about 240 MB; 920 MB on the disk)</source>
    <translation>パッケージインデックスから（ネットワーク：約 240 MB、ディスク：920 MB）</translation>
  </message>
  <message>
    <source>It is there: {folder}</source>
    <translation>あります：{folder}</translation>
  </message>
  <message>
    <source>It works: {program}</source>
    <translation>動作します：{program}</translation>
  </message>
  <message>
    <source>Make environment…</source>
    <translation>環境を作る…</translation>
  </message>
  <message>
    <source>Making furrowmap's environment</source>
    <translation>furrowmap の環境を作っています</translation>
  </message>
  <message>
    <source>None</source>
    <translation>なし</translation>
  </message>
  <message>
    <source>Not made yet. It would get: {folder}</source>
    <translation>まだありません。作る場所：{folder}</translation>
  </message>
  <message>
    <source>Remove it</source>
    <translation>削除</translation>
  </message>
  <message>
    <source>Removing furrowmap's environment</source>
    <translation>furrowmap の環境を削除しています</translation>
  </message>
  <message>
    <source>Stop</source>
    <translation>中止</translation>
  </message>
  <message>
    <source>Stopped; nothing is left of it.</source>
    <translation>中止しました。何も残っていません。</translation>
  </message>
  <message>
    <source>The environment is ready: furrowmap {version}.</source>
    <translation>環境の準備ができました：furrowmap {version}。</translation>
  </message>
  <message>
    <source>The environment was removed.</source>
    <translation>環境を削除しました。</translation>
  </message>
  <message>
    <source>furrowmap that does the work</source>
    <translation>計算を行う furrowmap</translation>
  </message>
</context>
<context>
  <name>PassLocator</name>
  <message>
    <source>Pass {number}</source>
    <translation>行程 {number}</translation>
  </message>
  <message>
    <source>furrowmap passes</source>
    <translation>furrowmap の行程</translation>
  </message>
</context>
<context>
  <name>Previewer</name>
  <message>
    <source>No preview: {reason}</source>
    <translation>プレビューできません：{reason}</translation>
  </message>
  <message>
    <source>Preview on the map: {figures}.</source>
    <translation>プレビューを地図に表示しました：{figures}。</translation>
  </message>
  <message>
    <source>Preview: {stage}…</source>
    <translation>プレビュー：{stage}…</translation>
  </message>
  <message>
    <source>starting</source>
    <translation>開始しています</translation>
  </message>
  <message>
    <source>the log tells why.</source>
    <translation>理由はログをご覧ください。</translation>
  </message>
</context>
<context>
  <name>Previews</name>
  <message>
    <source>Preview: {name}</source>
    <translation>プレビュー：{name}</translation>
  </message>
  <message>
    <source>coarse surface</source>
    <translation>粗い地表面</translation>
  </message>
  <message>
    <source>track</source>
    <translation>軌跡</translation>
  </message>
  <message>
    <source>{distance:,.0f} m driven in {time:,.0f} s</source>
    <translation>走行 {distance:,.0f} m、{time:,.0f} 秒</translation>
  </message>
  <message>
    <source>{share:.0%} of the positions fixed</source>
    <translation>測位の {share:.0%} がFIX解</translation>
  </message>
</context>
<context>
  <name>ResultPage</name>
  <message>
    <source>A page with map, legend and figures, and a page for each pass</source>
    <translation>地図、凡例、集計のページと、行程ごとのページ</translation>
  </message>
  <message>
    <source>Add to map</source>
    <translation>地図に追加</translation>
  </message>
  <message>
    <source>Back to the beginning</source>
    <translation>最初に戻る</translation>
  </message>
  <message>
    <source>Open folder</source>
    <translation>フォルダを開く</translation>
  </message>
  <message>
    <source>Open report</source>
    <translation>レポートを開く</translation>
  </message>
  <message>
    <source>Open the products, styled, in a group of their own</source>
    <translation>成果物をスタイル付きで専用のグループに開く</translation>
  </message>
  <message>
    <source>Other session</source>
    <translation>別のセッション</translation>
  </message>
  <message>
    <source>Play the drive in the temporal controller</source>
    <translation>走行を時系列コントローラで再生する</translation>
  </message>
  <message>
    <source>Print…</source>
    <translation>印刷…</translation>
  </message>
  <message>
    <source>Replay</source>
    <translation>再生</translation>
  </message>
  <message>
    <source>The page to read and to print, in the browser</source>
    <translation>ブラウザで読んで印刷できるページ</translation>
  </message>
  <message>
    <source>There is no report in this folder, so nothing is known of its accuracy.</source>
    <translation>このフォルダにはレポートがないため、精度は分かりません。</translation>
  </message>
  <message>
    <source>To be aware of</source>
    <translation>注意点</translation>
  </message>
  <message>
    <source>Where the products lie</source>
    <translation>成果物の場所</translation>
  </message>
</context>
<context>
  <name>Results</name>
  <message>
    <source>No {products} that QGIS can open in {folder}. Choose the folder of a run.</source>
    <translation>{folder} には QGIS で開ける {products} がありません。実行結果のフォルダを選んでください。</translation>
  </message>
</context>
<context>
  <name>RunPage</name>
  <message>
    <source>Cancel</source>
    <translation>取り消し</translation>
  </message>
  <message>
    <source>Stopping…</source>
    <translation>止めています…</translation>
  </message>
  <message>
    <source>{time} since the beginning</source>
    <translation>開始から {time}</translation>
  </message>
</context>
<context>
  <name>SessionLayout</name>
  <message>
    <source>Change of the surface</source>
    <translation>地表面の変化</translation>
  </message>
  <message>
    <source>Events</source>
    <translation>イベント</translation>
  </message>
  <message>
    <source>Missed</source>
    <translation>作業残し</translation>
  </message>
  <message>
    <source>Passes</source>
    <translation>行程</translation>
  </message>
  <message>
    <source>Trajectory</source>
    <translation>軌跡</translation>
  </message>
  <message>
    <source>Worked</source>
    <translation>作業した範囲</translation>
  </message>
  <message>
    <source>Worked twice</source>
    <translation>重複作業</translation>
  </message>
  <message>
    <source>pass</source>
    <translation>行程</translation>
  </message>
  <message>
    <source>{path} could not be written.</source>
    <translation>{path} に書き込めませんでした。</translation>
  </message>
  <message>
    <source>▲ north</source>
    <translation>▲ 北</translation>
  </message>
</context>
<context>
  <name>SessionPage</name>
  <message>
    <source>A recording is missing: drop the scanner's recording and the receiver's log together, from one folder.</source>
    <translation>記録が足りません。スキャナの記録と受信機のログを、1 つのフォルダから一緒にドロップしてください。</translation>
  </message>
  <message>
    <source>Back</source>
    <translation>戻る</translation>
  </message>
  <message>
    <source>Boundary</source>
    <translation>境界</translation>
  </message>
  <message>
    <source>CRS</source>
    <translation>CRS</translation>
  </message>
  <message>
    <source>Choose the map's coordinate reference system.</source>
    <translation>地図の座標参照系を選んでください。</translation>
  </message>
  <message>
    <source>Depth</source>
    <translation>深さ</translation>
  </message>
  <message>
    <source>Field</source>
    <translation>圃場</translation>
  </message>
  <message>
    <source>From the ground below the middle of the rear axle to the antenna's phase centre: forward, to the left, up. A tape measure's centimetre is good enough. Unchecked: the antenna counts as there.</source>
    <translation>後車軸中央の真下の地面から、アンテナの位相中心まで：前、左、上の順。巻尺で 1 cm まで測れば十分です。チェックを外すと、アンテナがその位置にあるとみなします。</translation>
  </message>
  <message>
    <source>GNSS antenna</source>
    <translation>GNSS アンテナ</translation>
  </message>
  <message>
    <source>Kind</source>
    <translation>種類</translation>
  </message>
  <message>
    <source>Name</source>
    <translation>名前</translation>
  </message>
  <message>
    <source>Optional: the parcel's outline in the session's folder, to find what was missed.</source>
    <translation>任意：セッションのフォルダにある区画の外形。作業残しを調べるのに使います。</translation>
  </message>
  <message>
    <source>Polygons (*.geojson *.gpkg *.shp *.kml)</source>
    <translation>ポリゴン (*.geojson *.gpkg *.shp *.kml)</translation>
  </message>
  <message>
    <source>Preview</source>
    <translation>プレビュー</translation>
  </message>
  <message>
    <source>Recordings</source>
    <translation>記録</translation>
  </message>
  <message>
    <source>Save</source>
    <translation>保存</translation>
  </message>
  <message>
    <source>Save and run</source>
    <translation>保存して実行</translation>
  </message>
  <message>
    <source>Say how wide the tool is, or uncheck 'Tool'.</source>
    <translation>作業機の幅を入れるか、「作業機」のチェックを外してください。</translation>
  </message>
  <message>
    <source>Scanner</source>
    <translation>スキャナ</translation>
  </message>
  <message>
    <source>Session</source>
    <translation>セッション</translation>
  </message>
  <message>
    <source>The map's projected CRS in metres, in which everything is computed and written.</source>
    <translation>地図の投影 CRS（メートル単位）。計算も書き出しもこの座標系で行います。</translation>
  </message>
  <message>
    <source>Tool</source>
    <translation>作業機</translation>
  </message>
  <message>
    <source>Where the scanner is, and how it is turned from lying level with its cable to the back. Scanning backwards and tilted down is about 0, 40, 180. The run refines the angles; within 2° is enough.</source>
    <translation>スキャナの位置と、ケーブルを後ろに向けて水平に置いた状態からの回転。後ろ下向きのスキャンなら、およそ 0, 40, 180 です。角度は実行時に補正されるので、2° 以内なら十分です。</translation>
  </message>
  <message>
    <source>Width</source>
    <translation>幅</translation>
  </message>
  <message>
    <source>Working width, and the middle of the line along which it works, seen from the rear axle: a tool behind has a negative x. Depth 0 means unknown. Unchecked: no ground worked is computed.</source>
    <translation>作業幅と、後車軸から見た作業線の中央。後方の作業機では x が負になります。深さ 0 は不明の意味です。チェックを外すと、作業した範囲は計算しません。</translation>
  </message>
  <message>
    <source>roll, pitch, yaw</source>
    <translation>ロール、ピッチ、ヨー</translation>
  </message>
  <message>
    <source>x, y</source>
    <translation>x、y</translation>
  </message>
  <message>
    <source>x, y, z</source>
    <translation>x、y、z</translation>
  </message>
  <message>
    <source>{path} cannot be written: {reason}.</source>
    <translation>{path} に書き込めません：{reason}。</translation>
  </message>
</context>
<context>
  <name>Stages</name>
  <message>
    <source>hashing inputs</source>
    <translation>入力ファイルのハッシュ計算</translation>
  </message>
  <message>
    <source>looking at scans</source>
    <translation>スキャンの確認</translation>
  </message>
  <message>
    <source>making surfaces</source>
    <translation>地表面の作成</translation>
  </message>
  <message>
    <source>matching scans</source>
    <translation>スキャンの照合</translation>
  </message>
  <message>
    <source>placing points</source>
    <translation>点の配置</translation>
  </message>
  <message>
    <source>reading positions</source>
    <translation>測位の読み込み</translation>
  </message>
  <message>
    <source>reading scans</source>
    <translation>スキャンの読み込み</translation>
  </message>
  <message>
    <source>work</source>
    <translation>作業の計算</translation>
  </message>
  <message>
    <source>writing cloud</source>
    <translation>点群の書き出し</translation>
  </message>
  <message>
    <source>writing layers</source>
    <translation>レイヤーの書き出し</translation>
  </message>
  <message>
    <source>writing the preview</source>
    <translation>プレビューの書き出し</translation>
  </message>
</context>
<context>
  <name>StartPage</name>
  <message>
    <source>Choose recordings or a session…</source>
    <translation>記録またはセッションを選ぶ…</translation>
  </message>
  <message>
    <source>Drop here
the recordings of a drive,
a session.toml
or the folder of a run</source>
    <translation>ここにドロップ
走行の記録、
session.toml、
または実行結果のフォルダ</translation>
  </message>
  <message>
    <source>Folder that 'furrowmap run' wrote</source>
    <translation>'furrowmap run' が書き出したフォルダ</translation>
  </message>
  <message>
    <source>Open the folder of a run…</source>
    <translation>実行結果のフォルダを開く…</translation>
  </message>
  <message>
    <source>Recent sessions</source>
    <translation>最近のセッション</translation>
  </message>
  <message>
    <source>Recordings of one drive, or a session</source>
    <translation>1 回の走行の記録、またはセッション</translation>
  </message>
  <message>
    <source>Results of others can be opened at once. To compute your own, furrowmap's worker has to be set up once: a Python environment of its own, which leaves QGIS's as it is. The next page asks before it does anything.</source>
    <translation>ほかの人の結果はすぐに開けます。自分で計算するには、furrowmap のワーカーを一度だけ設定します。QGIS とは別の Python 環境で、QGIS 自身には手を加えません。次の画面で確認してから始めます。</translation>
  </message>
  <message>
    <source>Set up…</source>
    <translation>設定…</translation>
  </message>
</context>
<context>
  <name>VehicleView</name>
  <message>
    <source>Upper: from the right side. Lower: from above. The origin is on the ground below the middle of the rear axle. Grey is a compact tractor to compare with. Blue lines show where the scanner's plane cuts.</source>
    <translation>上：右側面から。下：真上から。原点は後車軸中央の真下の地面です。灰色は比較用の小型トラクタ、青い線はスキャナの走査面が切る所です。</translation>
  </message>
  <message>
    <source>above</source>
    <translation>上面</translation>
  </message>
  <message>
    <source>antenna</source>
    <translation>アンテナ</translation>
  </message>
  <message>
    <source>scanner</source>
    <translation>スキャナ</translation>
  </message>
  <message>
    <source>side</source>
    <translation>側面</translation>
  </message>
  <message>
    <source>tool</source>
    <translation>作業機</translation>
  </message>
</context>
<context>
  <name>Worker</name>
  <message>
    <source>A line without end was thrown away.</source>
    <translation>終わりのない行を捨てました。</translation>
  </message>
  <message>
    <source>Check the interpreter in Settings › Options › furrowmap.</source>
    <translation>「設定 › オプション › furrowmap」でインタプリタを確かめてください。</translation>
  </message>
  <message>
    <source>Choose or make an environment in Settings › Options › furrowmap.</source>
    <translation>「設定 › オプション › furrowmap」で環境を選ぶか作ってください。</translation>
  </message>
  <message>
    <source>It left no message; perhaps the memory did not suffice.</source>
    <translation>メッセージはありません。メモリが足りなかったのかもしれません。</translation>
  </message>
  <message>
    <source>It said nothing at all.</source>
    <translation>何も出力しませんでした。</translation>
  </message>
  <message>
    <source>Nothing half-written is left.</source>
    <translation>書きかけのものは残っていません。</translation>
  </message>
  <message>
    <source>Stopped before the end.</source>
    <translation>途中で止めました。</translation>
  </message>
  <message>
    <source>The log has its last words. Products of an earlier run are as they were.</source>
    <translation>最後の出力はログにあります。以前の成果物は元のままです。</translation>
  </message>
  <message>
    <source>The worker ended without an answer (exit status {status}).</source>
    <translation>ワーカーが答えを返さずに終わりました（終了コード {status}）。</translation>
  </message>
  <message>
    <source>They do not understand each other, so nothing was done.</source>
    <translation>互いに通じないため、何も行いませんでした。</translation>
  </message>
  <message>
    <source>Update whichever is older: the plugin in QGIS's plugin manager, furrowmap in its environment.</source>
    <translation>古いほうを更新してください：プラグインは QGIS のプラグイン管理で、furrowmap はその環境で。</translation>
  </message>
  <message>
    <source>Without it nothing is computed; results that are there can still be opened.</source>
    <translation>これがないと計算はできませんが、既存の結果は開けます。</translation>
  </message>
  <message>
    <source>furrowmap {version} speaks protocol {found}; this plugin speaks {own}.</source>
    <translation>furrowmap {version} のプロトコルは {found}、このプラグインのプロトコルは {own} です。</translation>
  </message>
  <message>
    <source>{program} could not be started: {reason}.</source>
    <translation>{program} を起動できませんでした：{reason}。</translation>
  </message>
  <message>
    <source>{program} has not answered for {seconds:.0f} s.</source>
    <translation>{program} が {seconds:.0f} 秒間応答しません。</translation>
  </message>
</context>
</TS>
