<?xml version="1.0" encoding="utf-8"?>
<!DOCTYPE TS>
<TS version="2.1" language="ja">
<context>
  <name>Algorithms</name>
  <message><source>A connection URI such as postgresql://me@server/farm, instead of a GeoPackage. Keep passwords in PostgreSQL's password file.</source><translation>GeoPackage の代わりに使う接続 URI（例：postgresql://me@server/farm）。パスワードは PostgreSQL のパスワードファイルに置いてください。</translation></message>
  <message><source>A name, or a file to pass on that ends with .toml.</source><translation>名前、または人に渡すためのファイル（末尾は .toml）。</translation></message>
  <message><source>A project for QField instead of a web page</source><translation>ウェブページの代わりに QField 用プロジェクト</translation></message>
  <message><source>A surface or terrain model (GeoTIFF), or a cloud of bare soil.</source><translation>地表モデルまたは地形モデル（GeoTIFF）、または裸地の点群。</translation></message>
  <message><source>A surface through the bare soil around the parcels (default), or a plane around each.</source><translation>区画の周囲の裸地を通る曲面（既定）、または区画ごとの平面。</translation></message>
  <message><source>A table of the images and their times (CSV: file, time_unix_s), or one of the images, to use all in its folder with their EXIF times.</source><translation>画像とその時刻の表（CSV：file、time_unix_s）、または画像の一つ。画像を選ぶと同じフォルダの全画像を意味し、時刻は EXIF から読みます。</translation></message>
  <message><source>Accuracy</source><translation>精度</translation></message>
  <message><source>Add results to the farm map</source><translation>実行結果を農場マップに追加</translation></message>
  <message><source>Adds the results of runs to a farm map, a GeoPackage or a PostGIS database, which is created if it does not exist. Sessions that the farm map contains are replaced by the new result. If one of them fails, nothing is changed.</source><translation>実行結果を農場マップ（GeoPackage または PostGIS データベース）に追加します。農場マップがなければ作成します。すでに含まれているセッションは新しい結果で置き換えます。一つでも失敗した場合は何も変更しません。</translation></message>
  <message><source>Adds them to the project when the algorithm has finished.</source><translation>アルゴリズムの終了後にプロジェクトへ追加します。</translation></message>
  <message><source>Aligns the results of one field with each other on the ground that no tool touched in between, in height, tilt and place, and measures the soil moved from each date to the next, with standard deviations.</source><translation>一つの圃場の結果を、その間に作業機が触れていない地面によって、高さ、傾き、位置で互いに合わせ、各日付から次の日付までに動いた土の量を標準偏差とともに求めます。</translation></message>
  <message><source>Alley</source><translation>通路（列の間）</translation></message>
  <message><source>Allow damaged</source><translation>破損したファイルを許可</translation></message>
  <message><source>Allow large</source><translation>大きなファイルを許可</translation></message>
  <message><source>Also compute the published method.</source><translation>公表された方法も既定の方法とあわせて計算します。</translation></message>
  <message><source>Analyse the response of a trial</source><translation>試験の応答を解析</translation></message>
  <message><source>Angles of the board's axes in the vehicle frame, in degrees, in the first frame.</source><translation>最初の画像における、車両座標系での板の軸の角度（度）。</translation></message>
  <message><source>Another log of the same drive, or a trajectory.</source><translation>同じ走行の別のログ、または軌跡。</translation></message>
  <message><source>Antenna offset (m)</source><translation>アンテナのオフセット（m）</translation></message>
  <message><source>Attitude of a mount from images of a chessboard</source><translation>チェスボードの画像から取付部の姿勢を求める</translation></message>
  <message><source>Attitude of the mount</source><translation>取付部の姿勢</translation></message>
  <message><source>Average overlapping sessions instead of using the latest.</source><translation>重なる部分に最新のセッションではなく平均を使います。</translation></message>
  <message><source>Azimuth</source><translation>方位角</translation></message>
  <message><source>Base station (RINEX)</source><translation>基準局（RINEX）</translation></message>
  <message><source>Between the centres of the rear tyres, in metres.</source><translation>後輪タイヤの中心間の距離（m）。</translation></message>
  <message><source>Blocks</source><translation>ブロック</translation></message>
  <message><source>By default all layers.</source><translation>省略時はすべてのレイヤ。</translation></message>
  <message><source>By default beside the results. Formats with one layer per file need a folder.</source><translation>省略時は実行結果と同じ場所。1 ファイルに 1 レイヤの形式ではフォルダを指定します。</translation></message>
  <message><source>COPC file to write.</source><translation>書き出す COPC ファイル。</translation></message>
  <message><source>CRS of a new farm map</source><translation>新しい農場マップの CRS</translation></message>
  <message><source>CRS of a new farm map, such as EPSG:6677 [default: the first session's].</source><translation>新しい農場マップの CRS（例：EPSG:6677）。省略時は最初のセッションの CRS。</translation></message>
  <message><source>CRS of a point cloud whose file states none.</source><translation>CRS のない点群の CRS。</translation></message>
  <message><source>CRS of all products [default: that of the sessions].</source><translation>すべての成果物の CRS。省略時はセッションの CRS。</translation></message>
  <message><source>CRS of clouds without one</source><translation>CRS のない点群に使う CRS</translation></message>
  <message><source>CRS of input files without one.</source><translation>CRS のない入力ファイルの CRS。</translation></message>
  <message><source>CRS of points, or of a point cloud, whose file states none [default: that of the product].</source><translation>ファイルに CRS がない場合の測量点と点群の CRS。省略時は検証する成果物の CRS。</translation></message>
  <message><source>CRS of the clean point cloud</source><translation>クリーニング後の点群の CRS</translation></message>
  <message><source>CRS of the mosaic</source><translation>モザイクの CRS</translation></message>
  <message><source>CRS of the output</source><translation>出力の CRS</translation></message>
  <message><source>CRS of the output, in metres [default: that of the input].</source><translation>出力の CRS（メートル単位）。省略時は入力の CRS。</translation></message>
  <message><source>CRS of the point cloud</source><translation>点群の CRS</translation></message>
  <message><source>CRS of the points</source><translation>測量点の CRS</translation></message>
  <message><source>CRS of the raster [default: that of the surfaces].</source><translation>ラスタの CRS。省略時はサーフェスの CRS。</translation></message>
  <message><source>CRS of the surfaces</source><translation>サーフェスの CRS</translation></message>
  <message><source>CRS of the vector layers, such as EPSG:4326 [default: the session's].</source><translation>ベクタレイヤの CRS（例：EPSG:4326）。省略時はセッションの CRS。</translation></message>
  <message><source>CRS of the vectors</source><translation>ベクタの CRS</translation></message>
  <message><source>CSV or GeoPackage.</source><translation>CSV または GeoPackage。</translation></message>
  <message><source>CSV or spreadsheet with what each parcel or treatment received.</source><translation>各区画または各処理に何を与えたかを示す CSV または表計算ファイル。</translation></message>
  <message><source>Calibrate the mounting</source><translation>取り付けのキャリブレーション</translation></message>
  <message><source>Calibrations of antennas (ANTEX)</source><translation>アンテナの校正値（ANTEX）</translation></message>
  <message><source>Calibrations of antennas (ANTEX, such as igs20.atx): positions are then from marker to marker.</source><translation>アンテナの校正値（ANTEX、igs20.atx など）。位置は標石から標石へのものになります。</translation></message>
  <message><source>Cancelled; no partial files are left.</source><translation>キャンセルしました。書きかけのファイルは残っていません。</translation></message>
  <message><source>Canopy</source><translation>樹冠・群落</translation></message>
  <message><source>Canopy height</source><translation>樹冠高</translation></message>
  <message><source>Captures, bags, GNSS logs, trajectories, point clouds.</source><translation>LiDAR のキャプチャ、bag、GNSS ログ、軌跡、点群。</translation></message>
  <message><source>Cell size</source><translation>セルサイズ</translation></message>
  <message><source>Cell size [default: the smallest round size with four points per cell].</source><translation>セルサイズ。省略時は 1 セルに 4 点が入る切りのよい最小値。</translation></message>
  <message><source>Cell size of the mosaics [default: that of the latest surface].</source><translation>モザイクのセルサイズ。省略時は最新の表面のセルサイズ。</translation></message>
  <message><source>Cell size.</source><translation>セルサイズ。</translation></message>
  <message><source>Cell statistic</source><translation>セルの統計量</translation></message>
  <message><source>Change between dates</source><translation>日付間の変化</translation></message>
  <message><source>Change between dates of one field</source><translation>一つの圃場の日付間の変化</translation></message>
  <message><source>Chart of the response</source><translation>応答のグラフ</translation></message>
  <message><source>Check against surveyed points</source><translation>測量点による精度検証</translation></message>
  <message><source>Class codes to leave out, such as 64,65</source><translation>除外するクラスコード（例：64,65）</translation></message>
  <message><source>Class codes to use, such as 2,9</source><translation>使用するクラスコード（例：2,9）</translation></message>
  <message><source>Classified point cloud</source><translation>分類した点群</translation></message>
  <message><source>Classifies LAS, LAZ or COPC point clouds of any source by the shape and colour around each point: ground, horizontal and vertical planes, lines, vegetation. Writes the classified cloud, and layers of planes (roofs, walls), lines (poles, wires, fences) and plants. Memory use does not depend on the size of the area.</source><translation>任意の LAS、LAZ、COPC 点群を、各点の周囲の形状と色によって地表面、水平面、鉛直面、線状地物、植生に分類します。分類した点群と、面（屋根、壁）、線（柱、電線、柵）、植物のレイヤを書き出します。メモリ使用量は範囲の広さによりません。</translation></message>
  <message><source>Clean point cloud</source><translation>クリーニング後の点群</translation></message>
  <message><source>Clean point clouds</source><translation>点群を整える</translation></message>
  <message><source>Colour a point cloud by images</source><translation>画像で点群に色を付ける</translation></message>
  <message><source>Coloured point cloud</source><translation>色付き点群</translation></message>
  <message><source>Column of a covariate</source><translation>共変量の列</translation></message>
  <message><source>Column of a covariate, such as the yield of the year before.</source><translation>共変量（前年の収量など）の列。</translation></message>
  <message><source>Column of the dose</source><translation>施用量の列</translation></message>
  <message><source>Column of the dose [default: the first with a name such as n_kg_ha].</source><translation>施用量の列。省略時は n_kg_ha のような最初の列。</translation></message>
  <message><source>Column of the measure</source><translation>応答する量の列</translation></message>
  <message><source>Column of the response [default: mean_height_m].</source><translation>応答する量の列。省略時は mean_height_m。</translation></message>
  <message><source>Columns</source><translation>列数</translation></message>
  <message><source>Columns of other factors</source><translation>ほかの要因の列</translation></message>
  <message><source>Columns of sites and years</source><translation>場所と年の列</translation></message>
  <message><source>Combines the surfaces of a farm map's sessions into one raster. Where they overlap, the latest session is used. A .vrt is a small file that refers to the surfaces; a .tif is a cloud-optimised GeoTIFF with all bands.</source><translation>農場マップに含まれるセッションのサーフェスを一つのラスタに結合します。重なる部分では最新のセッションを使います。.vrt は元のサーフェスを参照する小さなファイル、.tif は全バンドを含むクラウド最適化 GeoTIFF です。</translation></message>
  <message><source>Compare points by their names, on each axis; CLOUD_OR_DSM may be a CSV of measured points.</source><translation>点を名前で対応させ、軸ごとに比較します。CLOUD_OR_DSM には計測した点の CSV も指定できます。</translation></message>
  <message><source>Compares a point cloud or a surface with surveyed points. The RMSE follows the ASPRS Positional Accuracy Standards, Edition 2 (2023), and includes the accuracy of the points.</source><translation>点群またはサーフェスを測量点と比較します。RMSE は ASPRS Positional Accuracy Standards 第 2 版（2023）に従い、測量点の精度を含みます。</translation></message>
  <message><source>Compares six shapes of the response to a dose, finds the dose that pays and the one beyond which nothing is gained, analyses the variance by treatment, factors and block, and computes growth from tables of several days. Writes charts, a table and response.json.</source><translation>施用量に対する応答の 6 つの曲線を比べ、採算の合う施用量と、それ以上増やしても効果がない施用量を求めます。処理、要因、ブロックによる分散分析も行い、複数の日の表から生育量を計算します。図、表、response.json を書き出します。</translation></message>
  <message><source>Compares the positions of GNSS logs with a reference at the same epochs: mean, standard deviation and RMSE in 3D, 2D, X, Y and Z, for all epochs and by fix type. Several services are compared in one table, and their tracks and errors become layers.</source><translation>GNSS ログの位置を同じエポックの基準と比較し、3D、2D、X、Y、Z の平均、標準偏差、RMSE を全エポックと測位解の種類ごとに求めます。複数のサービスは一つの表で比較され、軌跡と誤差はレイヤになります。</translation></message>
  <message><source>Compute the published method, too</source><translation>公表された方法も計算</translation></message>
  <message><source>Computes rasters from LAS, LAZ or COPC point clouds of any source: surface model (DSM), terrain model (DTM), height above ground, hillshade, slope, roughness, and low spots that hold water. Memory use does not depend on the size of the area.</source><translation>任意の LAS、LAZ、COPC 点群からラスタを計算します。表層モデル（DSM）、地形モデル（DTM）、地上高、陰影、傾斜、粗度、水のたまる窪地です。メモリ使用量は面積によりません。</translation></message>
  <message><source>Computes the attitude of a mount that moves against the vehicle, such as one on dampers, from images of a chessboard: the camera is on the mount and the board on the vehicle, or the other way round. A session names the table under [mount] attitude.</source><translation>ダンパーなどで車両に対して動く取付部の姿勢を、チェスボードの画像から計算します。カメラを取付部に、板を車両に置くか、その逆にします。セッションでは [mount] attitude にこの表を指定します。</translation></message>
  <message><source>Computes the georeferenced point cloud of a session's recording, detects in the scans when the implement is in the ground, and writes the worked ground, surfaces and a report.</source><translation>セッションの記録から地理座標付きの点群を計算し、作業機が土に入っている区間をスキャンから検出して、作業済みの範囲、サーフェス、レポートを出力します。</translation></message>
  <message><source>Computes the ground that a machine worked in each field from its ISO 11783-10 task data, without a scanner: passes, overlaps, missed strips and their areas.</source><translation>スキャナを使わず、機械の ISO 11783-10 作業データから圃場ごとの作業済みの範囲を計算します。行程、重複、作業残しとその面積が得られます。</translation></message>
  <message><source>Computes the positions of a rover relative to a base station from RINEX files, with RTKLIB's program rnx2rtkp, which you install yourself. To use the result, name it in a session as its GNSS log.</source><translation>RINEX ファイルから、基準局に対する移動局の位置を計算します。RTKLIB のプログラム rnx2rtkp がインストールされている必要があります。結果はセッションで GNSS ログとして指定します。</translation></message>
  <message><source>Content</source><translation>内容</translation></message>
  <message><source>Continue an interrupted run into DIR. Its scan matching is reused if session and recordings have not changed.</source><translation>強制終了や停電で中断した処理を、同じフォルダで続けます。セッションと記録が変わっていなければ、スキャンマッチングの結果を再利用します。</translation></message>
  <message><source>Converts the results of a run: GeoPackage, GeoParquet, FlatGeobuf, GeoJSON, Shapefile, KML, CSV, ISO 11783-10 task data for farm software and terminals, or a STAC catalogue of many runs. GeoJSON and KML are always in WGS 84.</source><translation>実行結果を変換します。GeoPackage、GeoParquet、FlatGeobuf、GeoJSON、Shapefile、KML、CSV、営農ソフトウェアと端末のための ISO 11783-10 作業データ、複数の実行をまとめた STAC カタログに対応します。GeoJSON と KML は常に WGS 84 です。</translation></message>
  <message><source>Coordinate transformations of a session</source><translation>セッションの座標変換</translation></message>
  <message><source>Copy the sensor positions of this machine: the name of a saved one, or its profile.</source><translation>センサーの位置をコピーする機械。保存した機械の名前、またはプロファイル。</translation></message>
  <message><source>Counts how often each spot was worked, when last, and how often rear wheels passed it, from the sessions of a farm map. To count wheel passes, state both widths.</source><translation>農場マップのセッションから、各地点の作業回数、最後の作業日、後輪の通過回数を数えます。車輪は両方の幅を指定したときに数えます。</translation></message>
  <message><source>Create a session file</source><translation>セッションファイルの作成</translation></message>
  <message><source>Crop height</source><translation>作物の高さ</translation></message>
  <message><source>Crops and trials</source><translation>作物と試験</translation></message>
  <message><source>Crops by parcel</source><translation>区画ごとの作物</translation></message>
  <message><source>Crops of {name}</source><translation>{name} の作物</translation></message>
  <message><source>Data exchange</source><translation>データ交換</translation></message>
  <message><source>Date of the first position</source><translation>最初の測位の日付</translation></message>
  <message><source>Day of the flight</source><translation>飛行日</translation></message>
  <message><source>Day up to which doses are summed [default: that of the points].</source><translation>施用量をこの日まで合計します。省略時は点群の計測日。</translation></message>
  <message><source>Days of the flights</source><translation>飛行日</translation></message>
  <message><source>Describe square cells with sides of this length.</source><translation>値を求める正方形のセルの一辺。</translation></message>
  <message><source>Describe these polygons instead of cells.</source><translation>セルの代わりに、値を求める領域。</translation></message>
  <message><source>Describes trees, orchards and other stands in LAS, LAZ or COPC point clouds: canopy height model, height percentiles, gap fraction and vertical profile, by square cell or by polygon.</source><translation>LAS、LAZ、COPC 点群から、樹木、果樹園などの林分・群落を調べます。樹冠高モデル（CHM）と、正方形のセルまたはポリゴンごとの高さのパーセンタイル、空隙率、垂直分布を求めます。</translation></message>
  <message><source>Detect targets at the points by intensity or colour, for the horizontal error.</source><translation>水平誤差を求めるため、測量点のターゲットを反射強度または色で検出します。</translation></message>
  <message><source>Diameter of discs, side of checkerboards.</source><translation>円板の直径、市松模様の板の一辺。</translation></message>
  <message><source>Diameter or side of the targets</source><translation>ターゲットの直径または一辺</translation></message>
  <message><source>Direction of the first row, clockwise from north, instead of its end.</source><translation>最初の行の終点の代わりに、その方向（北から時計回り）。</translation></message>
  <message><source>Direction of tillage</source><translation>耕うん方向</translation></message>
  <message><source>Direction of tillage, clockwise from grid north; removes tillage marks from the random roughness.</source><translation>座標北から時計回りの耕うん方向。ランダム粗度から耕うんの跡を除きます。</translation></message>
  <message><source>Distance between columns.</source><translation>列と列の間隔。</translation></message>
  <message><source>Distance between rows.</source><translation>行と行の間隔。</translation></message>
  <message><source>Draw the frames from the side and from above.</source><translation>座標系を横と上から見た図に描きます。</translation></message>
  <message><source>Drawing</source><translation>図</translation></message>
  <message><source>Elevation mask</source><translation>仰角マスク</translation></message>
  <message><source>End of the first row</source><translation>最初の行の終点</translation></message>
  <message><source>Ephemerides (RINEX)</source><translation>航法暦（RINEX）</translation></message>
  <message><source>Epochs of the reference</source><translation>基準のエポック</translation></message>
  <message><source>Estimates the scanner's mounting and the offset between its clock and the GNSS receiver's from the recording: on average the ground is level, and ground scanned twice coincides.</source><translation>スキャナの取り付けと、GNSS 受信機との時計のオフセットを記録から推定します。地面は平均して水平であること、二度計測した地面は一致することを使います。</translation></message>
  <message><source>Evaluate GNSS logs</source><translation>GNSS ログの評価</translation></message>
  <message><source>Evaluation (HTML)</source><translation>評価（HTML）</translation></message>
  <message><source>Every n-th point</source><translation>n 点ごとに 1 点</translation></message>
  <message><source>Example on the command line</source><translation>コマンドラインの例</translation></message>
  <message><source>Exit with status 4 if the results contradict each other. They are written nevertheless.</source><translation>結果が互いに矛盾する場合は終了ステータス 4 とします。結果はその場合も書き出されます。</translation></message>
  <message><source>Export results</source><translation>実行結果のエクスポート</translation></message>
  <message><source>Extent</source><translation>領域</translation></message>
  <message><source>Farm map</source><translation>農場マップ</translation></message>
  <message><source>Farm map (GeoPackage)</source><translation>農場マップ（GeoPackage）</translation></message>
  <message><source>Farm map (PostGIS)</source><translation>農場マップ（PostGIS）</translation></message>
  <message><source>Features (GeoPackage)</source><translation>地物（GeoPackage）</translation></message>
  <message><source>Features of point clouds</source><translation>点群から地物を抽出</translation></message>
  <message><source>Features of {name}</source><translation>{name} の地物</translation></message>
  <message><source>Field</source><translation>圃場</translation></message>
  <message><source>Field, drive and sensors. By default a small field that is tilled for a minute.</source><translation>圃場、走行、センサの設定。省略時は小さな圃場を 1 分間耕うんする例です。</translation></message>
  <message><source>Fields (JSON)</source><translation>圃場（JSON）</translation></message>
  <message><source>Fields, seasons and machines of the farm map</source><translation>農場マップの圃場・シーズン・機械</translation></message>
  <message><source>Figures by field (JSON)</source><translation>圃場ごとの集計（JSON）</translation></message>
  <message><source>File or folder written</source><translation>書き出したファイルまたはフォルダ</translation></message>
  <message><source>File to open</source><translation>開くファイル</translation></message>
  <message><source>File to write [default: name of ROVER with .pos].</source><translation>出力する .pos ファイル（既定は ROVER の名前に .pos を付けたもの）。</translation></message>
  <message><source>Files written</source><translation>書き出したファイル</translation></message>
  <message><source>Fill gaps up to this distance from the nearest measured height, but not beyond the outline of the data.</source><translation>最も近い計測値からこの距離までの欠損を補間します。データの外側は補間しません。</translation></message>
  <message><source>Findings (JSON)</source><translation>調査結果（JSON）</translation></message>
  <message><source>First corner</source><translation>最初の角</translation></message>
  <message><source>First day</source><translation>最初の日</translation></message>
  <message><source>First day of a season (MM-DD)</source><translation>シーズンの最初の日（MM-DD）</translation></message>
  <message><source>First day of a season, such as 04-01; kept in MAP [default: 01-01].</source><translation>シーズンの最初の日（例：04-01）。農場マップに保存されます。省略時は 01-01。</translation></message>
  <message><source>First number</source><translation>最初の番号</translation></message>
  <message><source>Folder for evaluation.json, evaluation.html, evaluation.gpkg, services.csv and epochs.csv.</source><translation>evaluation.json、evaluation.html、evaluation.gpkg、services.csv、epochs.csv のフォルダ。</translation></message>
  <message><source>Folder of the season.</source><translation>シーズンのフォルダー。</translation></message>
  <message><source>Format</source><translation>形式</translation></message>
  <message><source>Forward,left,up: from the antenna of the reference to that of the log, on the same vehicle. One line for all logs, or one for each.</source><translation>前,左,上の順。同じ車両上で、基準のアンテナからログのアンテナまで。全ログに共通なら 1 行、ログごとなら 1 行ずつ。</translation></message>
  <message><source>Found in the recordings</source><translation>記録から分かったこと</translation></message>
  <message><source>Frames of a session</source><translation>セッションの座標系</translation></message>
  <message><source>GeoPackage, Shapefile, GeoJSON, FlatGeobuf, KML, or a CSV of corners, in any CRS.</source><translation>GeoPackage、Shapefile、GeoJSON、FlatGeobuf、KML、または頂点の CSV。座標系は問いません。</translation></message>
  <message><source>Give either '{one}' or '{other}'.</source><translation>「{one}」か「{other}」のどちらか一方を指定してください。</translation></message>
  <message><source>Gross parcels: GeoPackage, Shapefile, GeoJSON, FlatGeobuf, KML, or a CSV of corners.</source><translation>区画全体のポリゴン。GeoPackage、Shapefile、GeoJSON、FlatGeobuf、KML、または角の座標の CSV。</translation></message>
  <message><source>Ground classification</source><translation>地面の分類</translation></message>
  <message><source>Ground classification method: ground becomes class 2, the rest class 1, except noise and the machine in furrowmap's own clouds. none keeps the classes.</source><translation>地面の分類方法。地面はクラス 2、その他はクラス 1 になります（ノイズと、furrowmap の点群の車両・作業機を除く）。none はクラスを変更しません。</translation></message>
  <message><source>Ground classification method; auto uses the ground class of the input if there is one, else smrf.</source><translation>地面の分類方法。auto は入力に地面のクラスがあればそれを、なければ smrf を使います。</translation></message>
  <message><source>Growth</source><translation>生育量</translation></message>
  <message><source>Growth of crops by parcel</source><translation>区画ごとの作物の生育</translation></message>
  <message><source>Height of a layer of the profile</source><translation>垂直分布の層の高さ</translation></message>
  <message><source>Height of a layer of the profile.</source><translation>垂直分布の層の高さ。</translation></message>
  <message><source>Height statistic per cell: median, trimmed, mean, min, max, or a percentile such as p90.</source><translation>セルごとの高さの統計量：median、trimmed、mean、min、max、または p90 などのパーセンタイル。</translation></message>
  <message><source>Highest return from the ground</source><translation>地面とみなす反射の最大の高さ</translation></message>
  <message><source>History of a field</source><translation>圃場の履歴</translation></message>
  <message><source>Images</source><translation>画像</translation></message>
  <message><source>Images with the board</source><translation>板が写っている画像の数</translation></message>
  <message><source>Inner corners of the chessboard</source><translation>チェスボードの内側の角の数</translation></message>
  <message><source>Inner corners of the chessboard, such as 9x6.</source><translation>チェスボードの内側の角の数。例：9x6。</translation></message>
  <message><source>Inputs</source><translation>入力</translation></message>
  <message><source>Inspect recordings</source><translation>記録を調べる</translation></message>
  <message><source>Its [camera] has the intrinsics. Without it they are estimated from the images.</source><translation>[camera] に内部パラメータがあるもの。指定しなければ画像から推定します。</translation></message>
  <message><source>Its [camera] names the images; GNSS and IMU give their poses. The scans are not read.</source><translation>[camera] で画像を指定したもの。位置と姿勢は GNSS と IMU から求めます。スキャンは読みません。</translation></message>
  <message><source>Its name or identifier; the list has the fields of the farm map.</source><translation>名前または識別子。一覧は農場マップの圃場です。</translation></message>
  <message><source>Keep every N-th point.</source><translation>N 点ごとに 1 点を使います。</translation></message>
  <message><source>Keep points in this box, in the CRS of the output.</source><translation>この領域内の点を使います。</translation></message>
  <message><source>Keep points of these classes [default: all but noise and, in furrowmap's own clouds, the machine].</source><translation>これらのクラスの点を使います。省略時はノイズと、furrowmap の点群の車両・作業機を除くすべて。</translation></message>
  <message><source>Known point</source><translation>既知点</translation></message>
  <message><source>LAS, LAZ or COPC file.</source><translation>LAS、LAZ、COPC ファイル。</translation></message>
  <message><source>LAS, LAZ or COPC files in one CRS.</source><translation>同じ座標参照系の LAS、LAZ、COPC ファイル。</translation></message>
  <message><source>LAS, LAZ or COPC files of two days or more.</source><translation>2 日以上の LAS、LAZ、COPC ファイル。</translation></message>
  <message><source>LAS, LAZ or COPC files, used together.</source><translation>LAS、LAZ、COPC ファイル。まとめて使います。</translation></message>
  <message><source>LAS, LAZ or COPC files; all go into one raster grid.</source><translation>LAS、LAZ、COPC ファイル。すべてを一つのラスタ格子にまとめます。</translation></message>
  <message><source>LAS, LAZ, COPC or GeoTIFF.</source><translation>LAS、LAZ、COPC、または GeoTIFF。</translation></message>
  <message><source>Last day</source><translation>最後の日</translation></message>
  <message><source>Latitude, longitude and height above the ellipsoid of its antenna, separated by commas; by default approximate, from its file.</source><translation>アンテナの緯度、経度、楕円体高をコンマで区切って指定します。省略した場合はファイルにある概略位置を使います。</translation></message>
  <message><source>Lay out the plots of a trial</source><translation>試験区を配置</translation></message>
  <message><source>Layers</source><translation>レイヤ</translation></message>
  <message><source>Leave out noise</source><translation>ノイズを除外</translation></message>
  <message><source>Leave out outliers and the noise classes 7 and 18 of the input.</source><translation>外れ値と、入力のノイズクラス 7、18 を除外します。</translation></message>
  <message><source>Leave out satellites below this elevation.</source><translation>この仰角より低い衛星を使いません。</translation></message>
  <message><source>Leave out the effects of blocks</source><translation>ブロックの効果を除く</translation></message>
  <message><source>Leave out the effects of blocks.</source><translation>ブロックの効果を除きます。</translation></message>
  <message><source>Leave out these classes; 64,65 are the machine in furrowmap's own clouds.</source><translation>これらのクラスを除外します。furrowmap の点群では 64,65 が車両と作業機です。</translation></message>
  <message><source>Length of a plot</source><translation>試験区の長さ</translation></message>
  <message><source>Length of a plot along the base line [default: from the two corners].</source><translation>基線に沿った試験区の長さ。省略時は二つの角の距離から求めます。</translation></message>
  <message><source>LiDAR captures or bags, GNSS logs and trajectories of one drive.</source><translation>1 回の走行の LiDAR キャプチャまたは bag、GNSS ログ、軌跡。</translation></message>
  <message><source>List the saved machines</source><translation>保存した機械の一覧</translation></message>
  <message><source>List the sessions of the farm map</source><translation>農場マップのセッション一覧</translation></message>
  <message><source>Lists the saved machines.</source><translation>保存した機械を一覧にします。</translation></message>
  <message><source>Lists the sessions of a farm map: identifier, date, worked area, name.</source><translation>農場マップに含まれるセッションの識別子、日付、作業面積、名前を一覧にします。</translation></message>
  <message><source>Lists the work of each field and season in a farm map, and that of each machine.</source><translation>農場マップの圃場・シーズンごとの作業と、機械ごとの作業を一覧にします。</translation></message>
  <message><source>Logs to evaluate</source><translation>評価するログ</translation></message>
  <message><source>Machine</source><translation>機械</translation></message>
  <message><source>Machines (JSON)</source><translation>機械（JSON）</translation></message>
  <message><source>Makes the plots of a trial as a grid of rectangles with identifiers and blocks. Click the outer corner of the first plot, and the other end of the first row.</source><translation>試験区を、番号とブロックを持つ長方形の格子として作成します。最初の試験区の外側の角と、最初の行のもう一方の端を地図上でクリックしてください。</translation></message>
  <message><source>Maximum gap to fill</source><translation>補間する欠損の最大幅</translation></message>
  <message><source>Maximum interpolation gap</source><translation>補間する最大間隔</translation></message>
  <message><source>Maximum interpolation gap of the reference [default: 1.5 times its interval].</source><translation>基準を補間する最大間隔。省略時は測位間隔の 1.5 倍。</translation></message>
  <message><source>Maximum number of rows of a Parquet file.</source><translation>Parquet ファイル 1 つの最大行数。</translation></message>
  <message><source>Mean of all sessions</source><translation>全セッションの平均</translation></message>
  <message><source>Measures height and volume of the crop on each parcel from LAS, LAZ or COPC point clouds of any source, with standard deviations: a layer of the parcels, a table, and a raster of crop heights.</source><translation>任意の LAS、LAZ、COPC 点群から、区画ごとに作物の高さと体積を標準偏差とともに求めます。区画のレイヤ、表、作物の高さのラスタを出力します。</translation></message>
  <message><source>Measures how much the crop on each parcel grew between flights of several days, aligned in height by the bare soil that they have in common, with standard deviations: a layer coloured by growth, and a table.</source><translation>日を変えて飛行した点群から、区画ごとの作物の生育量（高さの増加）を標準偏差とともに求めます。飛行間の高さは共通する裸地で揃えます。生育量で色分けしたレイヤと表を出力します。</translation></message>
  <message><source>Merges the results of many sessions, such as those of a list of drives: for each date a mosaic of the surfaces, of the change and of the worked ground, tables of points and trajectories, and a STAC catalogue. Unchanged parts are not computed again.</source><translation>走行の一覧など、多数のセッションの結果をまとめます：日付ごとの表面・変化・作業済み範囲のモザイク、点と軌跡の表、およびそれらすべての STAC カタログ。変わっていない部分は作り直しません。</translation></message>
  <message><source>Method for heights and volumes</source><translation>高さと体積の方法</translation></message>
  <message><source>Method for heights and volumes: the canopy's top, unbiased by point density, or as published in 2017.</source><translation>高さと体積の方法。点密度で偏らない群落上端、または 2017 年に公表された方法。</translation></message>
  <message><source>Metres to cut off each end and off each side of the gross parcels [default: none].</source><translation>区画全体の両端と両側から除く幅（m）。両端、両側の順 [既定値: なし]。</translation></message>
  <message><source>Missing from the recordings</source><translation>記録にないもの</translation></message>
  <message><source>Mosaic</source><translation>モザイク</translation></message>
  <message><source>Mosaic of the farm map's surfaces</source><translation>農場マップのサーフェスのモザイク</translation></message>
  <message><source>Most rows</source><translation>最大行数</translation></message>
  <message><source>NMEA, or other logs that 'Inspect recordings' reads.</source><translation>NMEA、または「記録を調べる」で読めるログ。</translation></message>
  <message><source>Names</source><translation>名前</translation></message>
  <message><source>Navigation files of the same day.</source><translation>同じ日の航法ファイル。</translation></message>
  <message><source>Net parcels from a file</source><translation>調査区画のファイル</translation></message>
  <message><source>Net parcels with the same identifiers, instead of an inset.</source><translation>同じ識別子をもつ調査区画。内側への幅の代わりに指定します。</translation></message>
  <message><source>Net parcels: metres off each end, off each side</source><translation>調査区画：両端と両側から除く幅（m）</translation></message>
  <message><source>Number each block anew</source><translation>ブロックごとに番号を付け直す</translation></message>
  <message><source>Number of areas</source><translation>領域の数</translation></message>
  <message><source>Number of changes</source><translation>変化の数</translation></message>
  <message><source>Number of parcels</source><translation>区画の数</translation></message>
  <message><source>Number of passes</source><translation>行程数</translation></message>
  <message><source>Number of plots across the base line.</source><translation>横に並ぶ試験区の数。</translation></message>
  <message><source>Number of plots along the base line.</source><translation>基線に沿った試験区の数。</translation></message>
  <message><source>Number of points</source><translation>点の数</translation></message>
  <message><source>Number of rows or columns in a block.</source><translation>1 ブロックの行数または列数。</translation></message>
  <message><source>Number of sessions</source><translation>セッションの数</translation></message>
  <message><source>Number of sessions left</source><translation>残りのセッション数</translation></message>
  <message><source>Number of sessions removed</source><translation>削除したセッション数</translation></message>
  <message><source>Number of surfaces</source><translation>サーフェスの数</translation></message>
  <message><source>Number of the first plot.</source><translation>最初の試験区の番号。</translation></message>
  <message><source>Number of threads [default: FURROWMAP_THREADS, else the number of processors, at most 8].</source><translation>スレッド数。省略時は FURROWMAP_THREADS、なければプロセッサ数（最大 8）。</translation></message>
  <message><source>Number of worker processes [default: by cores and memory].</source><translation>ワーカープロセスの数。省略時はコア数とメモリーから決まります。</translation></message>
  <message><source>Numbering</source><translation>番号の付け方</translation></message>
  <message><source>Numbers along</source><translation>番号の進む方向</translation></message>
  <message><source>Observations of the base station at the same time.</source><translation>同じ時刻の基準局の観測データ。</translation></message>
  <message><source>Observations of the rover.</source><translation>移動局の観測データ。</translation></message>
  <message><source>Of a rear tyre, in metres.</source><translation>後輪タイヤ 1 本の幅（m）。</translation></message>
  <message><source>Of a static antenna, instead of a log: latitude, longitude, height, separated by commas.</source><translation>ログの代わりに使う静止アンテナの位置。緯度、経度、高さをコンマで区切ります。</translation></message>
  <message><source>Of the services in the tables: one per line, in the order of the logs.</source><translation>表に示すサービス名。ログの順に 1 行に一つ。</translation></message>
  <message><source>One column per line, beside the dose.</source><translation>施用量のほかの要因の列を 1 行に 1 つ。</translation></message>
  <message><source>One column per line, such as location and year.</source><translation>場所や年などの列を 1 行に 1 つ。</translation></message>
  <message><source>One per line, in the order of the clouds: 2017-05-23.</source><translation>点群の順に 1 行に 1 つ：2017-05-23。</translation></message>
  <message><source>One per line, in the order of the tables: 2017-05-23.</source><translation>表の順に 1 行に 1 日（例：2017-05-23）。</translation></message>
  <message><source>One per line: the identifier, the beginning of it, or the name.</source><translation>1 行に一つ。識別子、その先頭部分、または名前。</translation></message>
  <message><source>Only sessions from this day on.</source><translation>この日以降のセッションだけ。</translation></message>
  <message><source>Only sessions up to this day.</source><translation>この日までのセッションだけ。</translation></message>
  <message><source>Only the ground in them is mapped: GeoPackage, Shapefile, GeoJSON, FlatGeobuf, KML, or task data.</source><translation>その中の地面だけを地図にします：GeoPackage、Shapefile、GeoJSON、FlatGeobuf、KML、作業データ。</translation></message>
  <message><source>Open the products as styled layers</source><translation>成果物をスタイル付きのレイヤとして開く</translation></message>
  <message><source>Other end of the base line: the outer corner of the first row's last plot.</source><translation>基線のもう一方の端。最初の行の最後の試験区の外側の角です。</translation></message>
  <message><source>Otherwise the algorithm stops if the output exists.</source><translation>チェックしない場合、出力先が存在すると停止します。</translation></message>
  <message><source>Outer corner of the first plot, where the base line begins.</source><translation>最初の試験区の外側の角。基線の始点です。</translation></message>
  <message><source>Outlier detection method</source><translation>外れ値の検出方法</translation></message>
  <message><source>Outlier detection method; outliers are left out.</source><translation>外れ値の検出方法。外れ値は除外します。</translation></message>
  <message><source>Outlier detection method; outliers become noise (class 7).</source><translation>外れ値の検出方法。外れ値はノイズ（クラス 7）になります。</translation></message>
  <message><source>Output file or folder</source><translation>出力ファイルまたはフォルダ</translation></message>
  <message><source>Output file.</source><translation>出力ファイル。</translation></message>
  <message><source>Output folder</source><translation>出力フォルダ</translation></message>
  <message><source>Output folder [default: beside RESULT].</source><translation>出力フォルダ［既定：RESULT の隣］。</translation></message>
  <message><source>Output folder.</source><translation>出力フォルダ。</translation></message>
  <message><source>Output raster (.tif).</source><translation>出力ラスタ（.tif）。</translation></message>
  <message><source>Output raster: .vrt or .tif.</source><translation>出力ラスタ：.vrt または .tif。</translation></message>
  <message><source>Output: .html for a page, .csv for a table.</source><translation>出力：ページは .html、表は .csv。</translation></message>
  <message><source>Outputs</source><translation>出力</translation></message>
  <message><source>Overwrite existing files</source><translation>既存のファイルを上書き</translation></message>
  <message><source>Page or table</source><translation>ページまたは表</translation></message>
  <message><source>Pairs</source><translation>名前で対応させる</translation></message>
  <message><source>Parcels</source><translation>区画</translation></message>
  <message><source>Path</source><translation>通路（行の間）</translation></message>
  <message><source>Pixel of the canopy height model</source><translation>樹冠高モデルの画素サイズ</translation></message>
  <message><source>Pixel of the canopy height model [default: the smallest round size with four points, up to 1 m].</source><translation>樹冠高モデルの画素サイズ。省略時は 1 画素に 4 点が入る切りのよい最小値（最大 1 m）。</translation></message>
  <message><source>Plots</source><translation>試験区</translation></message>
  <message><source>Plots, as .gpkg or .geojson.</source><translation>試験区（.gpkg または .geojson）。</translation></message>
  <message><source>Point cloud</source><translation>点群</translation></message>
  <message><source>Point cloud or surface</source><translation>点群またはサーフェス</translation></message>
  <message><source>Point clouds</source><translation>点群</translation></message>
  <message><source>Point spacing</source><translation>点間隔</translation></message>
  <message><source>Points and trajectories are GeoParquet, which needs the extra 'parquet'.</source><translation>点と軌跡は GeoParquet で、追加パッケージ 'parquet' が必要です。</translation></message>
  <message><source>Polygons instead of cells</source><translation>セルの代わりのポリゴン</translation></message>
  <message><source>Position of the base station</source><translation>基準局の位置</translation></message>
  <message><source>Position of the board; the camera is on the other part.</source><translation>板のある場所。カメラはもう一方にあります。</translation></message>
  <message><source>Positions</source><translation>位置</translation></message>
  <message><source>Positions from RINEX files</source><translation>RINEX ファイルから位置を計算</translation></message>
  <message><source>PostGIS schema</source><translation>PostGIS スキーマ</translation></message>
  <message><source>PostGIS schema of the tables.</source><translation>テーブルの PostGIS スキーマ。</translation></message>
  <message><source>Preview only</source><translation>プレビューのみ</translation></message>
  <message><source>Price of a unit of the dose</source><translation>施用量 1 単位の価格</translation></message>
  <message><source>Price of a unit of the dose, such as a kilogram of nitrogen, for the economic optimum.</source><translation>施用量 1 単位（窒素 1 kg など）の価格。経済的最適量に使います。</translation></message>
  <message><source>Price of a unit of the measure</source><translation>測定値 1 単位の価格</translation></message>
  <message><source>Price of a unit of the measure, such as a tonne of grain per hectare.</source><translation>測定値 1 単位（1 ヘクタール当たり子実 1 t など）の価格。</translation></message>
  <message><source>Process only the task with this identifier or name.</source><translation>この識別子または名前の作業だけを処理します。</translation></message>
  <message><source>Products of a season</source><translation>シーズンの成果物</translation></message>
  <message><source>Products of the same recording in it are replaced.</source><translation>同じ記録の成果物は置き換えられます。</translation></message>
  <message><source>Projected CRS of the plots, such as EPSG:25832.</source><translation>試験区の投影座標系（例：EPSG:25832）。</translation></message>
  <message><source>Projected CRS, such as EPSG:6677 [default: chosen from the location].</source><translation>投影 CRS（例：EPSG:6677）。省略時は場所から選びます。</translation></message>
  <message><source>Quick look within seconds: the track and a coarse surface from a few scans, without scan matching or implement detection. Replaces an earlier preview, never the products of a run.</source><translation>数秒で概略を確認します。軌跡と、少数のスキャンによる粗いサーフェスを作成し、スキャンマッチングと作業機の検出は行いません。以前のプレビューを置き換えますが、本処理の成果物は置き換えません。</translation></message>
  <message><source>Ratio of these prices</source><translation>価格の比</translation></message>
  <message><source>Read the undamaged parts of damaged clouds.</source><translation>破損した部分を除いて点群を使います。</translation></message>
  <message><source>Reads recordings and writes a commented session.toml with everything that they contain. It lists what they do not contain, such as the mounting of the scanner, and leaves comments where you enter it.</source><translation>記録を読み、その内容をコメント付きの session.toml に書き出します。スキャナの取り付けなど記録に含まれないものは、コメントとして残して知らせます。</translation></message>
  <message><source>Recordings</source><translation>記録</translation></message>
  <message><source>Reference log</source><translation>基準のログ</translation></message>
  <message><source>Refuse sessions in another CRS</source><translation>CRS の異なるセッションを拒否</translation></message>
  <message><source>Refuse sessions in another CRS instead of transforming them.</source><translation>CRS の異なるセッションを座標変換せずに拒否します。</translation></message>
  <message><source>Remove sessions from the farm map</source><translation>農場マップからセッションを削除</translation></message>
  <message><source>Removes sessions from a farm map. The folders of their results are not touched.</source><translation>農場マップからセッションを削除します。実行結果のフォルダは変更しません。</translation></message>
  <message><source>Replace the products of another recording</source><translation>別の記録の成果物を置き換える</translation></message>
  <message><source>Replace the products of another recording in DIR.</source><translation>フォルダにある別の記録の成果物を置き換えます。</translation></message>
  <message><source>Report (HTML)</source><translation>レポート（HTML）</translation></message>
  <message><source>Reports how a run transforms the coordinates of a session, with figures for the site: reference frame and epoch, size of the shift, geoid height, grid convergence and scale factor. Writes no files.</source><translation>実行時にセッションの座標がどう変換されるかを、現地での数値とともに報告します。基準座標系とエポック、移動量、ジオイド高、子午線収差角、縮尺係数です。ファイルは書き出しません。</translation></message>
  <message><source>Reports what recordings contain: sensor model, points, time span, clocks and their differences, fix types.</source><translation>記録の内容を報告します。センサの機種、点数、期間、時計とその差、測位解の種類です。</translation></message>
  <message><source>Required horizontal RMSE</source><translation>要求する水平 RMSE</translation></message>
  <message><source>Required vertical RMSE</source><translation>要求する鉛直 RMSE</translation></message>
  <message><source>Requirements met</source><translation>要求を満たす</translation></message>
  <message><source>Restart the numbers in each block: 101, 102, … 201.</source><translation>ブロックごとに番号を付け直します（101、102、… 201）。</translation></message>
  <message><source>Result of a run</source><translation>実行結果</translation></message>
  <message><source>Results of runs</source><translation>実行結果</translation></message>
  <message><source>Resume</source><translation>再開</translation></message>
  <message><source>Returns up to this height count as ground; in forests 2 is usual.</source><translation>地面からこの高さまでの反射を地面とみなします。森林では 2 m が一般的です。</translation></message>
  <message><source>Roll, pitch and yaw of the board</source><translation>板のロール、ピッチ、ヨー</translation></message>
  <message><source>Rover (RINEX)</source><translation>移動局（RINEX）</translation></message>
  <message><source>Rows</source><translation>行数</translation></message>
  <message><source>Rows or columns of a block</source><translation>1 ブロックの行数または列数</translation></message>
  <message><source>Run a session</source><translation>セッションの実行</translation></message>
  <message><source>Save the machine of a session</source><translation>セッションの機械を保存</translation></message>
  <message><source>Saves the positions of antenna, scanner, IMU, camera and implement from a session, for other sessions of the same machine.</source><translation>セッションに記入したアンテナ、スキャナ、IMU、カメラ、作業機の位置を保存し、同じ機械のセッションで使えるようにします。</translation></message>
  <message><source>Scenario</source><translation>シナリオ</translation></message>
  <message><source>Scheduler</source><translation>スケジューラー</translation></message>
  <message><source>Season</source><translation>シーズン</translation></message>
  <message><source>Seasons of fields (JSON)</source><translation>圃場のシーズン（JSON）</translation></message>
  <message><source>Session file</source><translation>セッションファイル</translation></message>
  <message><source>Session file to write [default: session.toml beside RECORDING].</source><translation>書き出すセッションファイル。省略時は記録と同じフォルダの session.toml。</translation></message>
  <message><source>Session file written</source><translation>セッションファイルに書き込み済み</translation></message>
  <message><source>Session with the intrinsics</source><translation>内部パラメータのあるセッション</translation></message>
  <message><source>Sessions</source><translation>セッション</translation></message>
  <message><source>Sessions (JSON)</source><translation>セッション（JSON）</translation></message>
  <message><source>Shape of the response</source><translation>応答の曲線</translation></message>
  <message><source>Shape of the response; auto compares all and averages over them by weight.</source><translation>応答の曲線。auto はすべてを比べ、重みで平均します。</translation></message>
  <message><source>Shape of the targets</source><translation>ターゲットの形</translation></message>
  <message><source>Shape of the targets that the points' file does not name in a column target.</source><translation>測点ファイルの列 target に種類のないターゲットの形。</translation></message>
  <message><source>Share a result</source><translation>実行結果の共有</translation></message>
  <message><source>Shows the frames of a session: earth, map, vehicle, and each sensor with its position, its angles and the directions of its axes in words, and draws them from the side and from above. Does not read the recordings.</source><translation>セッションの座標系を示します。地球、地図、車両、各センサの位置と角度、軸の向きを言葉で表します。図では横と上から見た様子を示します。記録は読み込みません。</translation></message>
  <message><source>Side</source><translation>側</translation></message>
  <message><source>Side of a square</source><translation>正方形の一辺</translation></message>
  <message><source>Side of a square.</source><translation>正方形の一辺の長さ。</translation></message>
  <message><source>Side of checkerboards</source><translation>市松模様の板の一辺</translation></message>
  <message><source>Side of checkerboards beside discs of another size [default: that of --diameter].</source><translation>円板と大きさの異なる市松模様の板の一辺 [既定: --diameter の値]。</translation></message>
  <message><source>Side of the base line on which the rows lie, looking along it.</source><translation>基線の進行方向に向かって、行が並ぶ側。</translation></message>
  <message><source>Side of the cells</source><translation>セルの一辺</translation></message>
  <message><source>Simulate a recording</source><translation>記録のシミュレーション</translation></message>
  <message><source>Soil below the crop</source><translation>作物の下の土壌面</translation></message>
  <message><source>Soil of another date</source><translation>別の日の地表面</translation></message>
  <message><source>Standard deviation of its heights</source><translation>その高さの標準偏差</translation></message>
  <message><source>Standard deviation of the heights of the reference.</source><translation>基準の高さの標準偏差。</translation></message>
  <message><source>Standard deviation of the survey</source><translation>測量の標準偏差</translation></message>
  <message><source>Standard deviation of the survey on each axis.</source><translation>測量の標準偏差（各軸）。</translation></message>
  <message><source>Stands by cell or polygon</source><translation>セルまたはポリゴンごとの樹冠・群落</translation></message>
  <message><source>Strict</source><translation>厳密</translation></message>
  <message><source>Surface</source><translation>サーフェス</translation></message>
  <message><source>Surfaces and point clouds</source><translation>サーフェスと点群</translation></message>
  <message><source>Surfaces from point clouds</source><translation>点群からサーフェスを作成</translation></message>
  <message><source>Surfaces of {name}</source><translation>{name} のサーフェス</translation></message>
  <message><source>Surveyed points</source><translation>測量点</translation></message>
  <message><source>Surveyed surface or points</source><translation>測量したサーフェスまたは点</translation></message>
  <message><source>TASKDATA.XML in its folder, or a .zip of the folder.</source><translation>フォルダの中の TASKDATA.XML、またはそのフォルダの .zip。</translation></message>
  <message><source>Table of errors</source><translation>誤差の表</translation></message>
  <message><source>Table of roll, pitch and yaw over time.</source><translation>ロール、ピッチ、ヨーの時系列の表。</translation></message>
  <message><source>Table of the areas</source><translation>領域の表</translation></message>
  <message><source>Table of the growth</source><translation>生育量の表</translation></message>
  <message><source>Table of the parcels</source><translation>区画の表</translation></message>
  <message><source>Table of the profiles</source><translation>垂直分布の表</translation></message>
  <message><source>Tables of parcels</source><translation>区画の表</translation></message>
  <message><source>Targets</source><translation>ターゲット</translation></message>
  <message><source>Task</source><translation>作業</translation></message>
  <message><source>Task data</source><translation>作業データ</translation></message>
  <message><source>The board is on the</source><translation>板のある場所</translation></message>
  <message><source>The dates are moved onto it: GeoTIFF, or CSV or GeoPackage of points.</source><translation>各日付の結果をこれに合わせて動かします。GeoTIFF、または点の CSV か GeoPackage です。</translation></message>
  <message><source>The farm's GeoPackage.</source><translation>農場の GeoPackage。</translation></message>
  <message><source>The first price over the second, instead of both.</source><translation>両方の価格の代わりに、前者を後者で割った比。</translation></message>
  <message><source>The output MET reports whether it is met.</source><translation>満たすかどうかは出力 MET に示されます。</translation></message>
  <message><source>The report.json of each run; it represents the folder of the run.</source><translation>各実行の report.json。そのフォルダを表します。</translation></message>
  <message><source>The report.json of the run; it represents the folder of the run.</source><translation>実行の report.json。実行結果のフォルダを表します。</translation></message>
  <message><source>The rover stands still</source><translation>移動局は静止</translation></message>
  <message><source>The rover stands still.</source><translation>移動局は静止しています。</translation></message>
  <message><source>The session.toml beside the recording; 'Create a session file' writes one.</source><translation>記録と同じフォルダの session.toml。「セッションファイルの作成」で作成できます。</translation></message>
  <message><source>The year in which it begins; all seasons by default.</source><translation>シーズンが始まる年。省略時はすべてのシーズン。</translation></message>
  <message><source>Thin the points to this spacing; 0 keeps all points.</source><translation>点をこの間隔まで間引きます。0 はすべての点。</translation></message>
  <message><source>Threads</source><translation>スレッド数</translation></message>
  <message><source>Time of a video's first frame</source><translation>動画の最初のフレームの時刻</translation></message>
  <message><source>Time of the first frame of a video, such as 2026-05-23T09:41:12.345 (UTC, or with a zone).</source><translation>動画の場合、最初のフレームの時刻。2026-05-23T09:41:12.345 のように指定します（UTC または時間帯付き）。</translation></message>
  <message><source>Time zone</source><translation>タイムゾーン</translation></message>
  <message><source>Time zone of dates and map tips, such as Asia/Tokyo [default: that of the run].</source><translation>日付と地図のヒントのタイムゾーン。例：Asia/Tokyo［既定：処理結果のもの］。</translation></message>
  <message><source>Track width</source><translation>輪距</translation></message>
  <message><source>Traffic</source><translation>走行</translation></message>
  <message><source>Traffic: how often each spot was worked and driven on</source><translation>走行：各地点の作業回数と通過回数</translation></message>
  <message><source>Treatments</source><translation>処理</translation></message>
  <message><source>Tyre width</source><translation>タイヤ幅</translation></message>
  <message><source>UTC date of the first position, for logs without a date.</source><translation>最初の測位の UTC 日付。日付のないログに使います。</translation></message>
  <message><source>Unpack files of any size.</source><translation>内容がどれほど大きくてもファイルを展開します。</translation></message>
  <message><source>Use every n-th frame</source><translation>n 枚ごとのフレームを使う</translation></message>
  <message><source>Use every n-th frame.</source><translation>n 枚ごとにフレームを使います。</translation></message>
  <message><source>Use the workers of this Dask scheduler: tls://HOST:PORT, or tcp:// without encryption.</source><translation>使用するワーカーの、稼働中の Dask スケジューラー：tls://HOST:PORT（tcp:// は暗号化なし）。</translation></message>
  <message><source>Voxel size</source><translation>ボクセルサイズ</translation></message>
  <message><source>Voxel size, the smallest detail [default: the point spacing, 0.05 to 0.4].</source><translation>ボクセルの大きさ（識別できる最小の細部）。既定値は点間隔（0.05～0.4）。</translation></message>
  <message><source>Voxel size; keep the point nearest to the centre of each voxel.</source><translation>ボクセルサイズ。各ボクセルの中心に最も近い点を残します。</translation></message>
  <message><source>Whether numbers run along rows (from column to column) or along columns.</source><translation>番号を行に沿って（列から列へ）進めるか、列に沿って進めるか。</translation></message>
  <message><source>Whether rows or columns are blocks (replicates).</source><translation>行または列をブロック（反復）とするかどうか。</translation></message>
  <message><source>Width of a plot</source><translation>試験区の幅</translation></message>
  <message><source>Width of a plot across the base line.</source><translation>基線に直交する試験区の幅。</translation></message>
  <message><source>Within polygons</source><translation>ポリゴンで切り抜く</translation></message>
  <message><source>Worked ground</source><translation>作業した範囲</translation></message>
  <message><source>Worked ground from task data (ISOXML)</source><translation>作業データ（ISOXML）から作業した範囲</translation></message>
  <message><source>Workers</source><translation>ワーカー数</translation></message>
  <message><source>Working width</source><translation>作業幅</translation></message>
  <message><source>Working width in metres [default: the largest in the logs].</source><translation>作業幅（メートル）。省略時はログにある最大の幅。</translation></message>
  <message><source>Write a CSV table of the errors at each point.</source><translation>各点の誤差の CSV 表を書き出します。</translation></message>
  <message><source>Write a QGIS project for QField instead of a web page.</source><translation>ウェブページの代わりに、QField 用の QGIS プロジェクトを書き出します。</translation></message>
  <message><source>Write passes, overlaps and misses to this GeoPackage.</source><translation>行程、重複、作業残しを書き出す GeoPackage。</translation></message>
  <message><source>Write the estimates into SESSION; its other lines do not change.</source><translation>推定値をセッションファイルに書き込みます。ほかの行は変更しません。</translation></message>
  <message><source>Write the estimates into the session file</source><translation>推定値をセッションファイルに書き込む</translation></message>
  <message><source>Write the mounting into this machine's profile, with the day and the standard deviations.</source><translation>取付角を、日付と標準偏差とともにこの機械のプロファイルに書き込みます。</translation></message>
  <message><source>Writes a LAS, LAZ or COPC point cloud of any source in the colours of the images of a session. Each point takes the colour of the best image that sees it; points that no image sees are black.</source><translation>任意の LAS、LAZ、COPC 点群に、セッションの画像の色を付けて書き出します。各点は、その点が最もよく見える画像の色になります。どの画像にも写っていない点は黒です。</translation></message>
  <message><source>Writes a simulated tractor recording: LiDAR packets, a GNSS log, a session file and the field boundary, with the ground truth. Useful to learn furrowmap and to plan a sensor mount.</source><translation>トラクタの模擬記録を作成します。LiDAR のパケット、GNSS ログ、セッションファイル、圃場の境界と、その真値です。furrowmap の学習やセンサ取り付けの検討に役立ちます。</translation></message>
  <message><source>Writes all sessions of a field in a farm map as a page with a map, or as a table (CSV).</source><translation>農場マップの圃場の全セッションを、地図付きのページまたは表（CSV）として書き出します。</translation></message>
  <message><source>Writes one COPC file from LAS, LAZ or COPC point clouds of any source: on request, outliers become noise, ground is classified, and the cloud is thinned. Memory use does not depend on the size of the area.</source><translation>任意の LAS、LAZ、COPC 点群から一つの COPC ファイルを作成します。指定に応じて、外れ値をノイズとし、地面を分類し、点群を間引きます。メモリ使用量は面積によりません。</translation></message>
  <message><source>Writes the result of a run as a folder for people without a GIS: a web page with map, layers, figures, point cloud in three dimensions and measuring, which opens from disk and needs no network; or a project for QField.</source><translation>GIS を使わない人のために、実行結果をフォルダに書き出します：地図、レイヤ、数値、3D 点群、計測を備え、ネットワークなしでディスクから開けるウェブページ、または QField 用プロジェクト。</translation></message>
  <message><source>dsm: after the work; dsm_before: before it; change: the difference.</source><translation>dsm：作業後、dsm_before：作業前、change：その差。</translation></message>
  <message><source>fixed: leave out epochs without a fixed solution in the reference.</source><translation>fixed：基準が FIX 解でないエポックを除外します。</translation></message>
  <message><source>furrowmap's worker is not set up. Choose or create its environment in Settings › Options › furrowmap.</source><translation>furrowmap のワーカーが設定されていません。「設定 › オプション › furrowmap」で環境を選択または作成してください。</translation></message>
  <message><source>isoxml writes task data into a folder, or into a .zip if the output's name ends in .zip. Only stac accepts several results.</source><translation>isoxml は作業データをフォルダに、出力名が .zip で終わる場合は .zip に書き出します。複数の実行結果を受け付けるのは stac だけです。</translation></message>
  <message><source>parcels.csv of runs, one for each day.</source><translation>実行結果の parcels.csv。1 日につき 1 ファイル。</translation></message>
  <message><source>serpentine: every second row or column is numbered backwards.</source><translation>serpentine では、一行または一列おきに逆向きに番号を付けます。</translation></message>
  <message><source>{parameter}: '{text}' has the wrong format. {help}</source><translation>{parameter}：「{text}」は形式が正しくありません。{help}</translation></message>
  <message><source>{parameter}: {path} does not exist.</source><translation>{parameter}：{path} が存在しません。</translation></message>
</context>
<context>
  <name>BaseMap</name>
  <message><source>'{own}' is not a base map. Give the address of a WMS or WMTS, a URL with {{z}}, {{x}} and {{y}}, or a file: MBTiles, GeoTIFF or another raster.</source><translation>「{own}」は背景地図ではありません。WMS・WMTS のアドレス、{{z}}・{{x}}・{{y}} を含む URL、またはファイル（MBTiles、GeoTIFF、その他のラスタ）を指定してください。</translation></message>
  <message><source>GSI aerial photo</source><translation>地理院タイル（写真）</translation></message>
  <message><source>GSI standard map</source><translation>地理院タイル（標準地図）</translation></message>
  <message><source>Geospatial Information Authority of Japan (GSI) tiles</source><translation>国土地理院（GSI）タイル</translation></message>
  <message><source>Own base map</source><translation>独自のベースマップ</translation></message>
  <message><source>{file} has vector tiles. Only raster tiles can be the base map.</source><translation>{file} はベクタタイルです。背景地図に使えるのはラスタタイルだけです。</translation></message>
  <message><source>{file} states no CRS. Assign one in QGIS first.</source><translation>{file} には座標参照系がありません。先に QGIS で設定してください。</translation></message>
  <message><source>© OpenStreetMap contributors</source><translation>© OpenStreetMap contributors</translation></message>
</context>
<context>
  <name>BaseMapChooser</name>
  <message><source>Address of a WMS or WMTS; URL of tiles with {z}, {x} and {y}; or path of an MBTiles file, a GeoTIFF or another raster</source><translation>WMS・WMTS のアドレス、{z}・{x}・{y} を含むタイルの URL、または MBTiles・GeoTIFF・その他のラスタのパス</translation></message>
  <message><source>Address or file</source><translation>アドレスまたはファイル</translation></message>
  <message><source>All files</source><translation>すべてのファイル</translation></message>
  <message><source>Attribution, if the map states none itself</source><translation>出典（地図自身に記載がない場合）</translation></message>
  <message><source>Base map</source><translation>ベースマップ</translation></message>
  <message><source>Layer</source><translation>レイヤ</translation></message>
  <message><source>Rasters and MBTiles (*.mbtiles *.tif *.tiff *.vrt *.jp2 *.png *.jpg)</source><translation>ラスタと MBTiles (*.mbtiles *.tif *.tiff *.vrt *.jp2 *.png *.jpg)</translation></message>
  <message><source>The base map {name} cannot be opened.</source><translation>背景地図 {name} を開けません。</translation></message>
  <message><source>The map of {host} cannot be reached: {reason}.
The other layers do not need it. Check the address and the network, or choose a map from a file.</source><translation>{host} の地図に接続できません：{reason}。
他のレイヤには影響しません。アドレスとネットワークを確認するか、ファイルの地図を選んでください。</translation></message>
  <message><source>none (offline)</source><translation>なし（オフライン）</translation></message>
  <message><source>other map…</source><translation>その他の地図…</translation></message>
  <message><source>{own} has no map layers of a WMS or WMTS.</source><translation>{own} には WMS・WMTS の地図レイヤがありません。</translation></message>
</context>
<context>
  <name>BatchPage</name>
  <message><source>Add what is done to farm map…</source><translation>完了分を農場マップに追加…</translation></message>
  <message><source>Cancel</source><translation>キャンセル</translation></message>
  <message><source>Double-click a drive to open its result, or its session where something is missing.</source><translation>走行をダブルクリックすると結果を開きます。不足があるときはセッションを開きます。</translation></message>
  <message><source>It lasts {duration:.1f} s.</source><translation>長さは {duration:.1f} 秒です。</translation></message>
  <message><source>Other session</source><translation>別のセッション</translation></message>
  <message><source>cancelled</source><translation>キャンセル済み</translation></message>
  <message><source>done</source><translation>完了</translation></message>
  <message><source>done, but it contradicts itself</source><translation>完了（結果に矛盾あり）</translation></message>
  <message><source>done, but the recording is cut</source><translation>完了（記録が途切れています）</translation></message>
  <message><source>failed</source><translation>失敗</translation></message>
  <message><source>not run: recordings or places are missing</source><translation>未実行：記録または位置が不足しています</translation></message>
  <message><source>running</source><translation>実行中</translation></message>
  <message><source>waiting</source><translation>待機中</translation></message>
  <message><source>{ended} of {all} drives</source><translation>{all} 件中 {ended} 件の走行が終了</translation></message>
</context>
<context>
  <name>Classes</name>
  <message><source>ground</source><translation>地面</translation></message>
  <message><source>high vegetation</source><translation>高植生</translation></message>
  <message><source>horizontal plane</source><translation>水平面</translation></message>
  <message><source>implement</source><translation>作業機</translation></message>
  <message><source>line</source><translation>線状地物</translation></message>
  <message><source>low vegetation</source><translation>低植生</translation></message>
  <message><source>medium vegetation</source><translation>中植生</translation></message>
  <message><source>noise</source><translation>ノイズ</translation></message>
  <message><source>other</source><translation>その他</translation></message>
  <message><source>vehicle</source><translation>車両</translation></message>
  <message><source>vertical plane</source><translation>鉛直面</translation></message>
</context>
<context>
  <name>DockWords</name>
  <message><source> under 'Results'</source><translation>「結果」で</translation></message>
  <message><source>'Camera', images</source><translation>「カメラ」の画像</translation></message>
  <message><source>'Field', boundary</source><translation>「圃場」の境界</translation></message>
  <message><source>'GNSS antenna', x, y, z</source><translation>「GNSS アンテナ」の x, y, z</translation></message>
  <message><source>'Implement', depth</source><translation>「作業機」の深さ</translation></message>
  <message><source>'Implement', kind</source><translation>「作業機」の種類</translation></message>
  <message><source>'Implement', width</source><translation>「作業機」の幅</translation></message>
  <message><source>'Implement', x, y</source><translation>「作業機」の x, y</translation></message>
  <message><source>'Parcels', file</source><translation>「区画」のファイル</translation></message>
  <message><source>'Parcels', treatments</source><translation>「区画」の処理</translation></message>
  <message><source>'Results': </source><translation>「結果」で</translation></message>
  <message><source>'Session', CRS</source><translation>「セッション」の CRS</translation></message>
  <message><source>'Session', recordings</source><translation>「セッション」の記録</translation></message>
  <message><source>'{part}' in Settings › Options › furrowmap</source><translation>設定 › オプション › furrowmap の「{part}」</translation></message>
  <message><source>Camera</source><translation>カメラ</translation></message>
  <message><source>Farm maps in PostGIS</source><translation>PostGIS の農場マップ</translation></message>
  <message><source>GeoParquet</source><translation>GeoParquet</translation></message>
  <message><source>Ground by a cloth (CSF)</source><translation>クロスによる地面の分類（CSF）</translation></message>
  <message><source>IMU</source><translation>IMU</translation></message>
  <message><source>Images of cameras (OpenCV, Pillow)</source><translation>カメラの画像（OpenCV、Pillow）</translation></message>
  <message><source>ROS bags</source><translation>ROS バッグ</translation></message>
  <message><source>Recordings in cloud storage</source><translation>クラウドストレージの記録</translation></message>
  <message><source>Scanner</source><translation>スキャナ</translation></message>
  <message><source>Statistics of trials and spreadsheets</source><translation>試験の統計と表計算ファイル</translation></message>
  <message><source>roll, pitch, yaw</source><translation>ロール, ピッチ, ヨー</translation></message>
  <message><source>x, y, z</source><translation>x, y, z</translation></message>
</context>
<context>
  <name>Figures</name>
  <message><source>, </source><translation>、</translation></message>
  <message><source>Accuracy</source><translation>精度</translation></message>
  <message><source>CRS</source><translation>CRS</translation></message>
  <message><source>Crop height</source><translation>作物の高さ</translation></message>
  <message><source>Crop volume</source><translation>作物の体積</translation></message>
  <message><source>Duration</source><translation>所要時間</translation></message>
  <message><source>Field</source><translation>圃場</translation></message>
  <message><source>Heading accuracy</source><translation>方位角の精度</translation></message>
  <message><source>Horizontal accuracy</source><translation>水平精度</translation></message>
  <message><source>Missed</source><translation>作業残し</translation></message>
  <message><source>Not worked</source><translation>未作業</translation></message>
  <message><source>Overlap</source><translation>重複</translation></message>
  <message><source>PPP</source><translation>PPP</translation></message>
  <message><source>Parcels</source><translation>区画</translation></message>
  <message><source>Passes</source><translation>行程</translation></message>
  <message><source>Path length</source><translation>走行距離</translation></message>
  <message><source>Points</source><translation>点数</translation></message>
  <message><source>Positions</source><translation>測位</translation></message>
  <message><source>RTK fixed</source><translation>RTK FIX</translation></message>
  <message><source>RTK float</source><translation>RTK FLOAT</translation></message>
  <message><source>Response</source><translation>応答</translation></message>
  <message><source>Start</source><translation>開始</translation></message>
  <message><source>This explains:</source><translation>これにより次のことも説明できます：</translation></message>
  <message><source>Vertical accuracy</source><translation>鉛直精度</translation></message>
  <message><source>Worked</source><translation>作業面積</translation></message>
  <message><source>depends on what the recording does not show: {keys}</source><translation>記録から確認できない次の値によります：{keys}</translation></message>
  <message><source>differential</source><translation>ディファレンシャル</translation></message>
  <message><source>no position</source><translation>測位なし</translation></message>
  <message><source>orientation of the scanner</source><translation>スキャナの向き</translation></message>
  <message><source>other</source><translation>その他</translation></message>
  <message><source>position of the antenna</source><translation>アンテナの位置</translation></message>
  <message><source>position of the scanner</source><translation>スキャナの位置</translation></message>
  <message><source>single</source><translation>単独測位</translation></message>
  <message><source>unknown, because the session leaves out: {keys}</source><translation>不明（セッションに次の記入がありません：{keys}）</translation></message>
  <message><source>{area}, {share:.0f} % of it worked</source><translation>{area}、うち {share:.0f} % を作業済み</translation></message>
  <message><source>{low:.1f} to {high:.1f} cm, mean {mean:.1f} cm</source><translation>{low:.1f}～{high:.1f} cm、平均 {mean:.1f} cm</translation></message>
</context>
<context>
  <name>Findings</name>
  <message><source>CRS: the recordings contain no position.</source><translation>CRS：記録に位置がありません。</translation></message>
  <message><source>Camera: fx, fy, cx and cy. Until then the images are not used.</source><translation>カメラ：fx、fy、cx、cy。入力するまで画像は使いません。</translation></message>
  <message><source>Found in the recordings: {kind}</source><translation>記録から分かったこと：{kind}</translation></message>
  <message><source>GNSS antenna: position. Until then no accuracy is stated.</source><translation>GNSS アンテナ：位置。記入するまで精度は示されません。</translation></message>
  <message><source>IMU: position and rotation of its axes. Until then its axes are those of the vehicle.</source><translation>IMU：位置と軸の回転。入力するまで軸は車体と同じとみなします。</translation></message>
  <message><source>IMU: position. Until then it is taken as that of the antenna.</source><translation>IMU：位置。入力するまでアンテナと同じ位置とみなします。</translation></message>
  <message><source>Implement: width and position. Until then no worked ground is computed.</source><translation>作業機：幅と位置。入力するまでは作業済みの範囲を計算しません。</translation></message>
  <message><source>Missing</source><translation>不足している項目</translation></message>
  <message><source>Not used</source><translation>使わないファイル</translation></message>
  <message><source>Scanner: position and orientation. Until then the surfaces are not usable.</source><translation>スキャナ：位置と向き。入力するまではサーフェスを利用できません。</translation></message>
  <message><source>Scanner: position. Until then no accuracy is stated.</source><translation>スキャナ：位置。入力するまで精度は示しません。</translation></message>
  <message><source>The receiver's log. Drop it together with the scanner's recording.</source><translation>受信機のログ。スキャナの記録と一緒にドロップしてください。</translation></message>
  <message><source>The scanner's recording. Drop it together with the receiver's log.</source><translation>スキャナの記録。受信機のログと一緒にドロップしてください。</translation></message>
  <message><source>To check</source><translation>確認が必要な項目</translation></message>
  <message><source>a drive</source><translation>走行</translation></message>
  <message><source>a flight</source><translation>飛行</translation></message>
  <message><source>positions alone</source><translation>測位のみ</translation></message>
  <message><source>scans alone</source><translation>スキャンのみ</translation></message>
</context>
<context>
  <name>FlightParts</name>
  <message><source>Camera</source><translation>カメラ</translation></message>
  <message><source>Choose the camera's table of images, or uncheck 'Camera'.</source><translation>カメラの画像の表を選ぶか、「カメラ」のチェックを外してください。</translation></message>
  <message><source>Class</source><translation>等級</translation></message>
  <message><source>Enter it: {name} = {value}</source><translation>入力する：{name} = {value}</translation></message>
  <message><source>Enter the size of the images, fx, fy, cx and cy of the camera.</source><translation>カメラの画像の大きさ、fx、fy、cx、cy を入力してください。</translation></message>
  <message><source>File</source><translation>ファイル</translation></message>
  <message><source>Files</source><translation>ファイル</translation></message>
  <message><source>IMU</source><translation>IMU</translation></message>
  <message><source>Images</source><translation>画像</translation></message>
  <message><source>Its class, or its model, such as VN-200. Empty: industrial.</source><translation>等級、または VN-200 などの型番。空欄：industrial（産業用）。</translation></message>
  <message><source>Optional: the parcels of a trial, for heights and volumes of the crop. The net parcel lies so far inside. Treatments: a table with the identifier of each parcel.</source><translation>任意：試験の区画のポリゴン。作物の高さと体積を求めます。収量調査区は区画の縁からこの距離だけ内側です。処理：各区画の識別子を含む表。</translation></message>
  <message><source>Parcels</source><translation>区画</translation></message>
  <message><source>Polygons (*.geojson *.gpkg *.shp *.kml *.csv)</source><translation>ポリゴン (*.geojson *.gpkg *.shp *.kml *.csv)</translation></message>
  <message><source>Position of the IMU, and rotation of its axes from forward, left, up. An IMU whose z axis points down has 180, 0, 0.</source><translation>IMU の位置と、前・左・上の向きからの軸の回転。z 軸が下を向く IMU は 180, 0, 0 です。</translation></message>
  <message><source>Tables (*.csv *.xlsx)</source><translation>表 (*.csv *.xlsx)</translation></message>
  <message><source>Tables (*.csv)</source><translation>表 (*.csv)</translation></message>
  <message><source>The table has a row for each image: file and time (UTC). Rotation of the optical frame: x right in the image, y down, z along the view; looking down with the top of the image forward: 180, 0, -90. Unchecked: no images are used.</source><translation>表には画像ごとにファイルと時刻（UTC）の行があります。光学座標系の回転：x は画像の右、y は下、z は視線方向。真下を向き画像の上が前方なら 180, 0, -90。チェックなし：画像を使いません。</translation></message>
  <message><source>Treatments</source><translation>処理</translation></message>
  <message><source>clock of the IMU minus GNSS time (s)</source><translation>IMU の時計 − GNSS 時刻（秒）</translation></message>
  <message><source>clock of the scanner minus GNSS time (s)</source><translation>スキャナの時計 − GNSS 時刻（秒）</translation></message>
  <message><source>clock of the tool's states minus GNSS time (s)</source><translation>作業機の状態の時計 − GNSS 時刻（秒）</translation></message>
  <message><source>distortion k1, k2</source><translation>歪み k1, k2</translation></message>
  <message><source>distortion p1, p2</source><translation>歪み p1, p2</translation></message>
  <message><source>focal length fx, fy</source><translation>焦点距離 fx, fy</translation></message>
  <message><source>off each end, off each side</source><translation>両端から、両側から</translation></message>
  <message><source>principal point cx, cy</source><translation>主点 cx, cy</translation></message>
  <message><source>roll, pitch, yaw</source><translation>ロール、ピッチ、ヨー</translation></message>
  <message><source>roll, pitch, yaw of the IMU</source><translation>IMU のロール、ピッチ、ヨー</translation></message>
  <message><source>width, height</source><translation>幅、高さ</translation></message>
  <message><source>x, y, z</source><translation>x, y, z</translation></message>
</context>
<context>
  <name>FurrowmapDock</name>
  <message><source>A part of furrowmap is not installed: {part}.</source><translation>furrowmap の一部がインストールされていません：{part}。</translation></message>
  <message><source>A task is running. Wait for its end, or cancel it.</source><translation>タスクを実行中です。終了を待つか、キャンセルしてください。</translation></message>
  <message><source>Add the session to the map first.</source><translation>先にセッションを地図に追加してください。</translation></message>
  <message><source>Added the machine {name}. Choose it in the form of a session.</source><translation>機械 {name} を追加しました。セッションのフォームで選んでください。</translation></message>
  <message><source>Adding to the farm map</source><translation>農場マップに追加中</translation></message>
  <message><source>Calibrated: the recording shows no other angles than the session states.</source><translation>キャリブレーション完了：記録が示す角度はセッションの記入と同じです。</translation></message>
  <message><source>Calibrated: the session has the angles that the recording shows.</source><translation>キャリブレーション完了：記録が示す角度をセッションに書き込みました。</translation></message>
  <message><source>Calibrating</source><translation>キャリブレーション中</translation></message>
  <message><source>Cancelled; no partial files are left.</source><translation>キャンセルしました。書きかけのファイルは残っていません。</translation></message>
  <message><source>Choose another folder for the results.</source><translation>結果のフォルダを別に選んでください。</translation></message>
  <message><source>Copy the recordings to a folder of this computer; they are not changed.</source><translation>記録をこのコンピュータのフォルダにコピーしてください。元の記録は変わりません。</translation></message>
  <message><source>Copying the recordings</source><translation>記録をコピーしています</translation></message>
  <message><source>Exported to {path}</source><translation>{path} にエクスポートしました</translation></message>
  <message><source>Exporting</source><translation>エクスポート中</translation></message>
  <message><source>Farm map</source><translation>農場マップ</translation></message>
  <message><source>File or folder of the export</source><translation>エクスポート先のファイルまたはフォルダ</translation></message>
  <message><source>Folder for the copy of the recordings, the session and the results</source><translation>記録のコピー、セッション、結果を置くフォルダ</translation></message>
  <message><source>Folder for the results</source><translation>結果のフォルダ</translation></message>
  <message><source>Folder of the page</source><translation>ページのフォルダ</translation></message>
  <message><source>Folder of the project</source><translation>プロジェクトのフォルダ</translation></message>
  <message><source>Inspecting the recordings</source><translation>記録を調べています</translation></message>
  <message><source>Install…</source><translation>インストール…</translation></message>
  <message><source>Log</source><translation>ログ</translation></message>
  <message><source>Make surfaces…</source><translation>サーフェスを作成…</translation></message>
  <message><source>Opened the existing session of these recordings.</source><translation>この記録の既存のセッションを開きました。</translation></message>
  <message><source>Running {name}</source><translation>{name} を実行中</translation></message>
  <message><source>Saved the machine {name}.</source><translation>機械 {name} を保存しました。</translation></message>
  <message><source>Saved {path}</source><translation>{path} を保存しました</translation></message>
  <message><source>Saving the machine</source><translation>機械を保存中</translation></message>
  <message><source>Set up furrowmap's worker to run sessions. Results can be opened without it.</source><translation>セッションを実行するには furrowmap のワーカーを設定してください。結果は設定しなくても開けます。</translation></message>
  <message><source>The drives are still running. Wait for their end, or cancel them in their list.</source><translation>走行の処理がまだ続いています。終わるまで待つか、一覧でキャンセルしてください。</translation></message>
  <message><source>The form cannot edit line {number} of {name}.</source><translation>{name} の {number} 行目はフォームで編集できません。</translation></message>
  <message><source>The machine {name} has them for its next sessions.</source><translation>機械 {name} にも保存しました。次のセッションから使われます。</translation></message>
  <message><source>The previous task is being cancelled; try again in a moment.</source><translation>前のタスクをキャンセルしています。少し待ってからやり直してください。</translation></message>
  <message><source>The session can be run as it is.</source><translation>セッションはこのまま実行できます。</translation></message>
  <message><source>The session can be run as it is. The results in {folder} are then replaced.</source><translation>セッションはこのまま実行できます。{folder} の結果は置き換えられます。</translation></message>
  <message><source>The session file of this result is not there any more: {path}.</source><translation>この結果のセッションファイルはもうありません：{path}。</translation></message>
  <message><source>The session is outside of the area of the project's CRS, {crs}: shapes are wrong.</source><translation>セッションはプロジェクトの CRS {crs} の適用範囲外にあり、形がゆがみます。</translation></message>
  <message><source>The task had ended before it could be cancelled.</source><translation>キャンセルする前に処理は終わっていました。</translation></message>
  <message><source>This QGIS has no 3D views.</source><translation>この QGIS には 3D ビューがありません。</translation></message>
  <message><source>This drive has not ended yet.</source><translation>この走行の処理はまだ終わっていません。</translation></message>
  <message><source>Use {crs}</source><translation>{crs} を使う</translation></message>
  <message><source>{count} sessions in the farm map.</source><translation>農場マップには {count} 件のセッションがあります。</translation></message>
  <message><source>{folder} is read-only, so that neither a session nor results can be written there.</source><translation>{folder} は読み取り専用で、セッションも結果も書き込めません。</translation></message>
  <message><source>{folder} is read-only, so that the results cannot be written there.</source><translation>{folder} は読み取り専用で、結果を書き込めません。</translation></message>
  <message><source>{names}: a point cloud alone needs no session. Surfaces can be made of it.</source><translation>{names}：点群だけならセッションは不要です。サーフェスを作成できます。</translation></message>
  <message><source>{path} cannot be added: {reason}.</source><translation>{path} を追加できません：{reason}。</translation></message>
  <message><source>{path} cannot be read: {reason}.</source><translation>{path} を読めません：{reason}。</translation></message>
  <message><source>{path} does not exist.</source><translation>{path} が存在しません。</translation></message>
  <message><source>{path} was not opened: this computer has no program for it.</source><translation>{path} を開けませんでした。このコンピュータには対応するプログラムがありません。</translation></message>
</context>
<context>
  <name>FurrowmapPlugin</name>
  <message><source>furrowmap</source><translation>furrowmap</translation></message>
</context>
<context>
  <name>Installer</name>
  <message><source>Check the network, or install from a folder of wheels.</source><translation>ネットワークを確認するか、wheel のフォルダからインストールしてください。</translation></message>
  <message><source>Choose a wheel of furrowmap, its source checkout, or a folder of wheels with the plugin's version.</source><translation>furrowmap の wheel、ソースのチェックアウト、またはプラグインと同じバージョンを含む wheel のフォルダを選択してください。</translation></message>
  <message><source>Compiling: this takes some minutes, once.</source><translation>コンパイルしています。最初の一度だけ数分かかります。</translation></message>
  <message><source>Download the wheels with the same version of Python on the same kind of computer.</source><translation>同じ種類のコンピュータと同じバージョンの Python で wheel をダウンロードしてください。</translation></message>
  <message><source>Install Python from python.org; on Debian and Ubuntu the package python3-venv. Then try again.</source><translation>python.org から Python をインストールし（Debian と Ubuntu では python3-venv パッケージ）、やり直してください。</translation></message>
  <message><source>Install the packages in the way in which furrowmap was installed.</source><translation>furrowmap をインストールしたのと同じ方法でパッケージをインストールしてください。</translation></message>
  <message><source>Installing failed: {reason}</source><translation>インストールに失敗しました：{reason}</translation></message>
  <message><source>No Python {oldest} to {newest} with venv was found.</source><translation>venv を備えた Python {oldest}～{newest} が見つかりません。</translation></message>
  <message><source>The checksum of {package} differs from the plugin's list.</source><translation>{package} のチェックサムがプラグインのリストと一致しません。</translation></message>
  <message><source>The environment was not created; an existing one is unchanged.</source><translation>環境は作成されませんでした。既存の環境は変更されていません。</translation></message>
  <message><source>The file is damaged or not the original. Download the wheels again, or use another source.</source><translation>ファイルが壊れているか、元のものではありません。wheel をダウンロードし直すか、別の入手元を使ってください。</translation></message>
  <message><source>The log above has the details.</source><translation>詳細は上のログにあります。</translation></message>
  <message><source>The package index cannot be reached.</source><translation>パッケージインデックスに接続できません。</translation></message>
  <message><source>There is no wheel of {package} for this computer and this Python.</source><translation>このコンピュータと Python に対応する {package} の wheel がありません。</translation></message>
  <message><source>{folder} has no wheel of {package} for this Python.</source><translation>{folder} に、この Python に対応する {package} の wheel がありません。</translation></message>
  <message><source>{program} has no Python beside it.</source><translation>{program} と同じ場所に Python がありません。</translation></message>
  <message><source>{program} is not furrowmap.</source><translation>{program} は furrowmap ではありません。</translation></message>
  <message><source>{source} has no furrowmap {version}.</source><translation>{source} に furrowmap {version} がありません。</translation></message>
</context>
<context>
  <name>Interpreter</name>
  <message><source>Chosen below.</source><translation>下で選ばれたものです。</translation></message>
  <message><source>Created by this plugin.</source><translation>このプラグインが作成しました。</translation></message>
  <message><source>Found on the PATH.</source><translation>PATH で見つかりました。</translation></message>
  <message><source>It installed this plugin with 'furrowmap qgis install'.</source><translation>'furrowmap qgis install' でこのプラグインをインストールしたものです。</translation></message>
  <message><source>None found. Existing results can be opened; to run sessions, choose or create one.</source><translation>見つかりません。既存の結果は開けます。セッションを実行するには、選択または作成してください。</translation></message>
</context>
<context>
  <name>Legends</name>
  <message><source>1.2 m and more</source><translation>1.2 m 以上</translation></message>
  <message><source>2 m and more</source><translation>2 m 以上</translation></message>
  <message><source>4 and more</source><translation>4 以上</translation></message>
  <message><source>Boundary of the field</source><translation>圃場の境界</translation></message>
  <message><source>Change from date {earlier} to date {later}</source><translation>日付 {earlier} から日付 {later} への変化</translation></message>
  <message><source>Change of the surface</source><translation>地表面の変化</translation></message>
  <message><source>Control points</source><translation>標定点</translation></message>
  <message><source>Cultivated path</source><translation>耕うん経路</translation></message>
  <message><source>Depth of water (m)</source><translation>水深（m）</translation></message>
  <message><source>Differences of strips</source><translation>ストリップ間の差</translation></message>
  <message><source>Differences of swaths</source><translation>スワス間の差</translation></message>
  <message><source>Events of the drive</source><translation>走行中のイベント</translation></message>
  <message><source>Fields</source><translation>圃場</translation></message>
  <message><source>Ground not worked</source><translation>未作業の範囲</translation></message>
  <message><source>Ground worked twice</source><translation>重複した範囲</translation></message>
  <message><source>Growth of the crop</source><translation>作物の生育量</translation></message>
  <message><source>Headland and body</source><translation>枕地と本体</translation></message>
  <message><source>Height above ground</source><translation>地面からの高さ</translation></message>
  <message><source>Height above ground (m)</source><translation>地面からの高さ（m）</translation></message>
  <message><source>Height change (m)</source><translation>高さの変化（m）</translation></message>
  <message><source>Height difference of swaths (mm)</source><translation>スワス間の高さの差（mm）</translation></message>
  <message><source>Height of the canopy</source><translation>樹冠の高さ</translation></message>
  <message><source>Height of the canopy (m)</source><translation>樹冠の高さ（m）</translation></message>
  <message><source>Height of the crop</source><translation>作物の高さ</translation></message>
  <message><source>Height of the crop (m)</source><translation>作物の高さ（m）</translation></message>
  <message><source>Low spots</source><translation>くぼ地</translation></message>
  <message><source>Machines</source><translation>機械</translation></message>
  <message><source>Missed ground</source><translation>作業残し</translation></message>
  <message><source>Number of strips</source><translation>ストリップの数</translation></message>
  <message><source>Orthophoto</source><translation>オルソ画像</translation></message>
  <message><source>Parcels of the trial</source><translation>区画</translation></message>
  <message><source>Passes of the tool</source><translation>行程</translation></message>
  <message><source>Paths of the vehicle</source><translation>車両の経路</translation></message>
  <message><source>Point cloud of the run</source><translation>点群</translation></message>
  <message><source>Points a square metre</source><translation>1 m²あたりの点数</translation></message>
  <message><source>Positions of the vehicle</source><translation>車両の位置</translation></message>
  <message><source>Relief</source><translation>起伏</translation></message>
  <message><source>Relief after the work</source><translation>作業後の起伏</translation></message>
  <message><source>Relief before the work</source><translation>作業前の起伏</translation></message>
  <message><source>Relief of the ground</source><translation>地面の起伏</translation></message>
  <message><source>Reports and settings of the sessions</source><translation>セッションのレポートと設定</translation></message>
  <message><source>Roughness</source><translation>粗さ</translation></message>
  <message><source>Roughness (m)</source><translation>粗さ（m）</translation></message>
  <message><source>Sessions</source><translation>セッション</translation></message>
  <message><source>Slope</source><translation>傾斜</translation></message>
  <message><source>Slope (°)</source><translation>傾斜（°）</translation></message>
  <message><source>Strips of the flight</source><translation>飛行のストリップ</translation></message>
  <message><source>Surface</source><translation>表面</translation></message>
  <message><source>Surface after the work</source><translation>作業後の地表面</translation></message>
  <message><source>Surface before the work</source><translation>作業前の地表面</translation></message>
  <message><source>Surface of the ground</source><translation>地面の表面</translation></message>
  <message><source>Work of each season</source><translation>シーズンごとの作業</translation></message>
  <message><source>Work of each session</source><translation>セッションごとの作業</translation></message>
  <message><source>Worked ground</source><translation>作業した範囲</translation></message>
  <message><source>none: turns alone</source><translation>なし（旋回のみ）</translation></message>
  <message><source>unknown</source><translation>不明</translation></message>
</context>
<context>
  <name>Options</name>
  <message><source>A task of furrowmap is running. Wait for its end, or cancel it.</source><translation>furrowmap の処理が実行中です。終わるまで待つか、キャンセルしてください。</translation></message>
  <message><source>Another one (a Python interpreter with furrowmap, or the furrowmap command):</source><translation>別のもの（furrowmap の入った Python インタプリタ、または furrowmap コマンド）：</translation></message>
  <message><source>Cancel</source><translation>キャンセル</translation></message>
  <message><source>Cancelled; nothing was changed.</source><translation>キャンセルしました。何も変更していません。</translation></message>
  <message><source>Choose where furrowmap is to be installed from.</source><translation>furrowmap のインストール元を選択してください。</translation></message>
  <message><source>Create a Python environment for furrowmap in {folder}? It takes {size} MB on the disk. QGIS's Python is not changed.</source><translation>{folder} に furrowmap の Python 環境を作成しますか？ディスクを {size} MB 使います。QGIS の Python は変わりません。</translation></message>
  <message><source>Create environment…</source><translation>環境を作成…</translation></message>
  <message><source>Created in {folder}</source><translation>作成済み：{folder}</translation></message>
  <message><source>Created in {folder} ({size} MB)</source><translation>{folder} に作成済み（{size} MB）</translation></message>
  <message><source>Creating furrowmap's environment</source><translation>furrowmap の環境を作成しています</translation></message>
  <message><source>Delete furrowmap's environment in {folder}? Sessions cannot be run without it.</source><translation>{folder} の furrowmap の環境を削除しますか？環境がないとセッションを実行できません。</translation></message>
  <message><source>Delete…</source><translation>削除…</translation></message>
  <message><source>Deleting furrowmap's environment</source><translation>furrowmap の環境を削除しています</translation></message>
  <message><source>Environment of the plugin</source><translation>プラグインの環境</translation></message>
  <message><source>Found automatically</source><translation>自動検出</translation></message>
  <message><source>From a folder with the wheels of furrowmap and its dependencies (offline)</source><translation>furrowmap と依存パッケージの wheel のフォルダから（オフライン）</translation></message>
  <message><source>From a wheel or source checkout; dependencies from the package index (240 MB to download)</source><translation>wheel またはソースのチェックアウトから。依存パッケージはパッケージインデックスから（ダウンロード 240 MB）</translation></message>
  <message><source>Further parts of furrowmap</source><translation>furrowmap の追加部分</translation></message>
  <message><source>Install</source><translation>インストール</translation></message>
  <message><source>Installed: {packages}.</source><translation>インストールしました：{packages}。</translation></message>
  <message><source>Installing packages</source><translation>パッケージをインストールしています</translation></message>
  <message><source>It works: {program}</source><translation>動作します：{program}</translation></message>
  <message><source>None</source><translation>なし</translation></message>
  <message><source>Not created. Folder: {folder}</source><translation>未作成。作成先：{folder}</translation></message>
  <message><source>Test</source><translation>テスト</translation></message>
  <message><source>Testing furrowmap</source><translation>furrowmap をテストしています</translation></message>
  <message><source>The environment is ready: furrowmap {version}.</source><translation>環境の準備ができました：furrowmap {version}。</translation></message>
  <message><source>The environment was deleted.</source><translation>環境を削除しました。</translation></message>
  <message><source>Wheel or checkout (furrowmap-*.whl pyproject.toml)</source><translation>wheel またはチェックアウト (furrowmap-*.whl pyproject.toml)</translation></message>
  <message><source>furrowmap in use</source><translation>使用する furrowmap</translation></message>
</context>
<context>
  <name>PassLocator</name>
  <message><source>Pass {number}</source><translation>行程 {number}</translation></message>
  <message><source>furrowmap passes</source><translation>furrowmap の行程</translation></message>
</context>
<context>
  <name>Places</name>
  <message><source>there is a file or folder of this name already</source><translation>同じ名前のファイルかフォルダがすでにあります</translation></message>
  <message><source>{needed:,.1f} GB are needed, {free:,.1f} GB are free</source><translation>必要な容量は {needed:,.1f} GB、空きは {free:,.1f} GB です</translation></message>
</context>
<context>
  <name>Previewer</name>
  <message><source>No preview: {reason}</source><translation>プレビューできません：{reason}</translation></message>
  <message><source>Preview on the map: {figures}.</source><translation>プレビューを地図に表示しました：{figures}。</translation></message>
  <message><source>Preview: {stage}…</source><translation>プレビュー：{stage}…</translation></message>
  <message><source>starting</source><translation>開始しています</translation></message>
</context>
<context>
  <name>Previews</name>
  <message><source>Preview: {name}</source><translation>プレビュー：{name}</translation></message>
  <message><source>coarse surface</source><translation>粗いサーフェス</translation></message>
  <message><source>the times or positions are damaged</source><translation>時刻または位置が壊れています</translation></message>
  <message><source>trajectory</source><translation>軌跡</translation></message>
  <message><source>{distance:,.0f} m in {time:,.0f} s</source><translation>{distance:,.0f} m、{time:,.0f} 秒</translation></message>
  <message><source>{share:.0%} RTK fixed</source><translation>RTK FIX {share:.0%}</translation></message>
</context>
<context>
  <name>ResultPage</name>
  <message><source>3D view</source><translation>3D ビュー</translation></message>
  <message><source>A layout with map, legend and figures, and a page per pass</source><translation>地図、凡例、集計と、行程ごとのページのレイアウト</translation></message>
  <message><source>Add to farm map…</source><translation>農場マップに追加…</translation></message>
  <message><source>Add to map</source><translation>地図に追加</translation></message>
  <message><source>Back to its form, to change it and run it again</source><translation>フォームに戻り、変更してもう一度実行します</translation></message>
  <message><source>Back to the drives</source><translation>走行一覧に戻る</translation></message>
  <message><source>CSV of poses: the trajectory, for furrowmap</source><translation>姿勢の CSV：軌跡（furrowmap 用）</translation></message>
  <message><source>CSV: spreadsheets</source><translation>CSV：表計算ソフト</translation></message>
  <message><source>Edit this session</source><translation>このセッションを編集</translation></message>
  <message><source>Export</source><translation>エクスポート</translation></message>
  <message><source>FlatGeobuf: web maps</source><translation>FlatGeobuf：ウェブ地図</translation></message>
  <message><source>GeoJSON: web maps, in WGS 84</source><translation>GeoJSON：ウェブ地図（WGS 84）</translation></message>
  <message><source>GeoPackage: any GIS, with styles</source><translation>GeoPackage：各種 GIS、スタイル付き</translation></message>
  <message><source>GeoParquet: analysis in Python, R or DuckDB</source><translation>GeoParquet：Python・R・DuckDB での解析</translation></message>
  <message><source>ISO 11783 task data: farm software</source><translation>ISO 11783 作業データ：営農ソフト</translation></message>
  <message><source>KML: Google Earth</source><translation>KML：Google Earth</translation></message>
  <message><source>On the map</source><translation>地図の表示</translation></message>
  <message><source>One file of all sessions, a layer for each kind</source><translation>すべてのセッションを種類別のレイヤで一つのファイルに</translation></message>
  <message><source>Open folder</source><translation>フォルダを開く</translation></message>
  <message><source>Open report</source><translation>レポートを開く</translation></message>
  <message><source>Open the HTML report in the browser</source><translation>HTML レポートをブラウザで開く</translation></message>
  <message><source>Open the folder of the products</source><translation>成果物のフォルダを開く</translation></message>
  <message><source>Open the products as styled layers in a group</source><translation>成果物をスタイル付きのレイヤとしてグループに開く</translation></message>
  <message><source>Other session</source><translation>別のセッション</translation></message>
  <message><source>Play the drive; ground worked, change and a visible cloud grow with it</source><translation>走行を再生します。作業済みの地面、変化、表示中の点群が走行に合わせて現れます</translation></message>
  <message><source>Print…</source><translation>印刷…</translation></message>
  <message><source>Project for QField…</source><translation>QField 用プロジェクト…</translation></message>
  <message><source>Replay</source><translation>再生</translation></message>
  <message><source>SBET: the trajectory, for LiDAR software</source><translation>SBET：軌跡（LiDAR ソフト用）</translation></message>
  <message><source>STAC: a catalogue of the products</source><translation>STAC：成果物のカタログ</translation></message>
  <message><source>Shapefile: older GIS</source><translation>シェープファイル：従来の GIS</translation></message>
  <message><source>TUM: the trajectory, for robotics</source><translation>TUM：軌跡（ロボティクス用）</translation></message>
  <message><source>The visible layers in three dimensions</source><translation>表示中のレイヤを立体で表示します</translation></message>
  <message><source>This folder has no report, so the accuracy is unknown.</source><translation>このフォルダにはレポートがないため、精度は不明です。</translation></message>
  <message><source>Warnings</source><translation>警告</translation></message>
  <message><source>Web page with map and 3D, to share…</source><translation>共有用のウェブページ（地図と 3D）…</translation></message>
  <message><source>glTF: the surface in 3D, with its orthophoto</source><translation>glTF：オルソ画像付きの 3D 表面</translation></message>
  <message><source>{count} more warnings below the figures</source><translation>ほかに {count} 件の警告が数値の下にあります</translation></message>
</context>
<context>
  <name>Results</name>
  <message><source>Crops</source><translation>作物</translation></message>
  <message><source>Passes and events</source><translation>行程とイベント</translation></message>
  <message><source>Quality of the data</source><translation>データの品質</translation></message>
  <message><source>Surface and change</source><translation>地表面と変化</translation></message>
  <message><source>The group of {folder} was removed while it was opened.</source><translation>{folder} を開いている間に、そのグループが削除されました。</translation></message>
  <message><source>Worked ground</source><translation>作業した範囲</translation></message>
  <message><source>{folder} has no {products} that QGIS can open. Choose the folder of a run.</source><translation>{folder} には QGIS で開ける {products} がありません。実行結果のフォルダを選択してください。</translation></message>
</context>
<context>
  <name>RunPage</name>
  <message><source>Cancel</source><translation>キャンセル</translation></message>
  <message><source>Cancelling…</source><translation>キャンセルしています…</translation></message>
  <message><source>Elapsed: {time}</source><translation>経過時間：{time}</translation></message>
</context>
<context>
  <name>SessionLayout</name>
  <message><source>Area</source><translation>面積</translation></message>
  <message><source>Depth (approximate)</source><translation>深さ（目安）</translation></message>
  <message><source>Length</source><translation>長さ</translation></message>
  <message><source>Pass</source><translation>行程</translation></message>
  <message><source>Speed</source><translation>速度</translation></message>
  <message><source>Time ({zone})</source><translation>時刻（{zone}）</translation></message>
  <message><source>Tool</source><translation>作業機</translation></message>
  <message><source>Width</source><translation>幅</translation></message>
  <message><source>pass</source><translation>行程</translation></message>
  <message><source>unknown</source><translation>不明</translation></message>
  <message><source>▲ north</source><translation>▲ 北</translation></message>
</context>
<context>
  <name>SessionPage</name>
  <message><source>(missing: drop the recording here)</source><translation>（未指定：記録をここにドロップしてください）</translation></message>
  <message><source>A projected CRS in metres, for computation and output.</source><translation>計算と出力に使う、メートル単位の投影 CRS。</translation></message>
  <message><source>A recording is missing. Drop it here: the scanner's recording and the receiver's log, from one folder.</source><translation>記録が足りません。スキャナの記録と受信機のログを、同じフォルダからここにドロップしてください。</translation></message>
  <message><source>Add another tool</source><translation>作業機を追加</translation></message>
  <message><source>Back</source><translation>戻る</translation></message>
  <message><source>Boundary</source><translation>境界</translation></message>
  <message><source>CRS</source><translation>CRS</translation></message>
  <message><source>Calibrate</source><translation>キャリブレーション</translation></message>
  <message><source>Camera</source><translation>カメラ</translation></message>
  <message><source>Choose a saved machine, or type a name</source><translation>保存した機械を選ぶか、名前を入力</translation></message>
  <message><source>Choose another folder, then run again.</source><translation>別のフォルダを選んでから、もう一度実行してください。</translation></message>
  <message><source>Choose the map's coordinate reference system.</source><translation>地図の座標参照系を選んでください。</translation></message>
  <message><source>Copy the session and its recordings to a folder of this computer.</source><translation>セッションと記録をこのコンピュータのフォルダにコピーしてください。</translation></message>
  <message><source>Copy to a folder of this computer…</source><translation>このコンピュータのフォルダにコピー…</translation></message>
  <message><source>Depth</source><translation>深さ</translation></message>
  <message><source>Drone or helicopter</source><translation>ドローン・ヘリコプター</translation></message>
  <message><source>Empty: the folder beside the session that is shown in grey.</source><translation>空欄の場合は、灰色で示すセッションと同じ場所のフォルダです。</translation></message>
  <message><source>Enter the width of the implement, or uncheck 'Implement'.</source><translation>作業機の幅を入力するか、「作業機」のチェックを外してください。</translation></message>
  <message><source>Field</source><translation>圃場</translation></message>
  <message><source>Fill in the position and the approximate angles of the scanner first.</source><translation>先にスキャナの位置とおおよその角度を記入してください。</translation></message>
  <message><source>Fill in the positions of antenna and scanner first.</source><translation>先にアンテナとスキャナの位置を記入してください。</translation></message>
  <message><source>Find the scanner's angles in the recording; write them into the session and the chosen machine.</source><translation>記録からスキャナの角度を求め、セッションと選んだ機械に書き込みます。</translation></message>
  <message><source>Folder</source><translation>フォルダ</translation></message>
  <message><source>GNSS antenna</source><translation>GNSS アンテナ</translation></message>
  <message><source>IMU</source><translation>IMU</translation></message>
  <message><source>Implement</source><translation>作業機</translation></message>
  <message><source>Keep both</source><translation>両方残す</translation></message>
  <message><source>Kind</source><translation>種類</translation></message>
  <message><source>Machine</source><translation>機械</translation></message>
  <message><source>Name</source><translation>名前</translation></message>
  <message><source>No machine {name} is saved. Press 'Save as machine' first, or clear the name to calibrate the session alone.</source><translation>機械 {name} は保存されていません。先に「機械として保存」を押すか、名前を消してセッションだけを校正してください。</translation></message>
  <message><source>Not known: choose it</source><translation>不明：選んでください</translation></message>
  <message><source>Optional: a polygon in the session's folder, to find missed ground.</source><translation>任意：作業残しを調べるための、セッションのフォルダにあるポリゴン。</translation></message>
  <message><source>Phase centre of the antenna in the aircraft's frame: forward, left, up. Any point may be the origin of that frame; if it is the antenna, 0, 0, 0. A centimetre is accurate enough. Unchecked: not known.</source><translation>機体座標系でのアンテナの位相中心（前、左、上）。原点は任意の点で、アンテナを原点とするなら 0, 0, 0。1 cm の精度で十分です。チェックなし：不明。</translation></message>
  <message><source>Phase centre of the antenna, from the point on the ground below the middle of the rear axle: forward, left, up. A centimetre is accurate enough. Unchecked: not known.</source><translation>アンテナの位相中心。後車軸中央の直下の地面からの位置（前、左、上）。1 cm の精度で十分です。チェックなし：不明。</translation></message>
  <message><source>Polygons (*.geojson *.gpkg *.shp *.kml)</source><translation>ポリゴン (*.geojson *.gpkg *.shp *.kml)</translation></message>
  <message><source>Position in the same frame, and rotation of the scanner's axes from forward, left, up; its spin axis is z. One that sweeps across the track has about -90, 0, -90. The run refines the angles; within 2° is accurate enough.</source><translation>同じ座標系での位置と、前・左・上の向きからのスキャナの軸の回転。回転軸は z です。進行方向と直角に走査するものは約 -90, 0, -90。角度は処理で精密化されるので、2° 以内の精度で十分です。</translation></message>
  <message><source>Position, and rotation from level with the cable to the rear. A scanner that faces backwards and is tilted down has about 0, 40, 180. The run refines the angles; within 2° is accurate enough.</source><translation>スキャナの位置と、ケーブルを後ろに向けた水平な姿勢からの回転。後ろ下向きのスキャナではおよそ 0, 40, 180 です。角度は実行時に補正されるため、2° 以内で十分です。</translation></message>
  <message><source>Preview</source><translation>プレビュー</translation></message>
  <message><source>Recordings</source><translation>記録</translation></message>
  <message><source>Replace its places by those of the form, or type another name.</source><translation>フォームの位置で置き換えるか、別の名前を入力してください。</translation></message>
  <message><source>Replace the machine</source><translation>機械を置き換える</translation></message>
  <message><source>Replace them</source><translation>置き換える</translation></message>
  <message><source>Results</source><translation>結果</translation></message>
  <message><source>Run without accuracy</source><translation>精度なしで実行</translation></message>
  <message><source>Save</source><translation>保存</translation></message>
  <message><source>Save and run</source><translation>保存して実行</translation></message>
  <message><source>Save as machine</source><translation>機械として保存</translation></message>
  <message><source>Scanner</source><translation>スキャナ</translation></message>
  <message><source>Scanners of this session: {}. Shown here is the first; the others stay as they are.</source><translation>このセッションのスキャナ：{}。ここには一台目の値を示し、ほかはそのまま残ります。</translation></message>
  <message><source>Session</source><translation>セッション</translation></message>
  <message><source>The machine {name} cannot be read.</source><translation>機械 {name} を読めません。</translation></message>
  <message><source>Tractor or other ground vehicle</source><translation>トラクタなどの地上車両</translation></message>
  <message><source>Type a name for the machine.</source><translation>機械の名前を入力してください。</translation></message>
  <message><source>Vehicle</source><translation>車体</translation></message>
  <message><source>Width</source><translation>幅</translation></message>
  <message><source>Working width, and the middle of the working line relative to the rear axle; x is negative behind it. Depth 0 means unknown. Unchecked: no worked ground is computed.</source><translation>作業幅と、後車軸から見た作業線の中央。後方では x が負になります。深さ 0 は不明を表します。チェックを外すと作業済みの範囲を計算しません。</translation></message>
  <message><source>roll, pitch, yaw</source><translation>ロール、ピッチ、ヨー</translation></message>
  <message><source>tool {number}</source><translation>作業機 {number}</translation></message>
  <message><source>x, y</source><translation>x、y</translation></message>
  <message><source>x, y, z</source><translation>x、y、z</translation></message>
  <message><source>{path} cannot be written: {reason}.</source><translation>{path} に書き込めません：{reason}。</translation></message>
  <message><source>{title}: not filled in</source><translation>{title}：未記入</translation></message>
</context>
<context>
  <name>Stages</name>
  <message><source>adjusting images</source><translation>画像を調整しています</translation></message>
  <message><source>cleaning clouds</source><translation>点群のクリーニング</translation></message>
  <message><source>exporting</source><translation>エクスポート</translation></message>
  <message><source>filling gaps</source><translation>欠損の補間</translation></message>
  <message><source>finding features</source><translation>特徴点を抽出しています</translation></message>
  <message><source>hashing inputs</source><translation>入力ファイルのハッシュ計算</translation></message>
  <message><source>looking at control points</source><translation>標定点の観測</translation></message>
  <message><source>looking at scans</source><translation>スキャンの確認</translation></message>
  <message><source>looking for noise</source><translation>ノイズの検出</translation></message>
  <message><source>looking for the board</source><translation>板を探しています</translation></message>
  <message><source>making surfaces</source><translation>サーフェスの作成</translation></message>
  <message><source>matching images</source><translation>画像を対応付けています</translation></message>
  <message><source>matching scans</source><translation>スキャンマッチング</translation></message>
  <message><source>measuring density</source><translation>点密度の測定</translation></message>
  <message><source>placing points</source><translation>点の配置</translation></message>
  <message><source>reading clouds</source><translation>点群の読み込み</translation></message>
  <message><source>reading images</source><translation>画像を読んでいます</translation></message>
  <message><source>reading positions</source><translation>測位の読み込み</translation></message>
  <message><source>reading results</source><translation>実行結果の読み込み</translation></message>
  <message><source>reading scans</source><translation>スキャンの読み込み</translation></message>
  <message><source>waiting for another process</source><translation>ほかのプロセスの終了待ち</translation></message>
  <message><source>work</source><translation>作業の計算</translation></message>
  <message><source>writing cloud</source><translation>点群の書き出し</translation></message>
  <message><source>writing layers</source><translation>レイヤの書き出し</translation></message>
  <message><source>writing the farm map</source><translation>農場マップの書き出し</translation></message>
  <message><source>writing the mosaic</source><translation>モザイクの書き出し</translation></message>
  <message><source>writing the page</source><translation>ページの書き出し</translation></message>
  <message><source>writing the preview</source><translation>プレビューの書き出し</translation></message>
  <message><source>writing the project</source><translation>プロジェクトの書き出し</translation></message>
</context>
<context>
  <name>StartPage</name>
  <message><source>Choose a folder for the results…</source><translation>結果のフォルダを選ぶ…</translation></message>
  <message><source>Choose recordings or a session…</source><translation>記録またはセッションを選択…</translation></message>
  <message><source>Copy to a folder of this computer…</source><translation>このコンピュータのフォルダにコピー…</translation></message>
  <message><source>Drop here:
recordings of a drive,
their folder, a session.toml,
a machine or the folder of a run.
Several sessions or folders run one after another.</source><translation>ここにドロップ：
一回の走行の記録、
そのフォルダ、session.toml、
機械、または実行結果のフォルダ。
複数のセッションやフォルダは順に実行します。</translation></message>
  <message><source>Existing results can be opened at once. To run sessions, set up furrowmap's worker: a separate Python environment. QGIS's Python is not changed.</source><translation>既存の結果はすぐに開けます。セッションを実行するには、furrowmap のワーカー（独立した Python 環境）を設定してください。QGIS の Python は変更しません。</translation></message>
  <message><source>Folder that 'furrowmap run' wrote</source><translation>'furrowmap run' が書き出したフォルダ</translation></message>
  <message><source>Open the folder of a run…</source><translation>実行結果のフォルダを開く…</translation></message>
  <message><source>Recent sessions</source><translation>最近のセッション</translation></message>
  <message><source>Recordings of one drive, or a session</source><translation>1 回の走行の記録、またはセッション</translation></message>
  <message><source>Run it as it is</source><translation>このまま実行</translation></message>
  <message><source>Set up…</source><translation>設定…</translation></message>
  <message><source>The last list of {count} drives…</source><translation>前回の走行一覧（{count} 件）…</translation></message>
</context>
<context>
  <name>VehicleView</name>
  <message><source>Above: from the right side. Below: from the top. The origin is on the ground below the middle of the rear axle. Grey: a compact tractor for comparison. Blue lines: the scan plane.</source><translation>上：右側面図。下：上面図。原点は後車軸中央の真下の地面です。灰色：比較用の小型トラクタ。青線：走査面。</translation></message>
  <message><source>Above: from the right side. Below: from the top; the nose is on the right. Grey: a drone for comparison, with the origin on top of it. Blue lines: the scan plane.</source><translation>上：右側面図。下：上面図（機首は右）。灰色：比較用のドローン（原点はその上面）。青線：走査面。</translation></message>
  <message><source>IMU</source><translation>IMU</translation></message>
  <message><source>antenna</source><translation>アンテナ</translation></message>
  <message><source>camera</source><translation>カメラ</translation></message>
  <message><source>implement</source><translation>作業機</translation></message>
  <message><source>scanner</source><translation>スキャナ</translation></message>
  <message><source>side</source><translation>側面</translation></message>
  <message><source>top</source><translation>上面</translation></message>
</context>
<context>
  <name>Worker</name>
  <message><source>A line of output was too long and was dropped.</source><translation>出力の行が長すぎるため破棄しました。</translation></message>
  <message><source>Cancelled.</source><translation>キャンセルしました。</translation></message>
  <message><source>Choose or create an environment in Settings › Options › furrowmap.</source><translation>「設定 › オプション › furrowmap」で環境を選択または作成してください。</translation></message>
  <message><source>It was ended. Products of an earlier run are unchanged.</source><translation>終了させました。以前の実行の成果物は変わりません。</translation></message>
  <message><source>It wrote no output.</source><translation>出力はありません。</translation></message>
  <message><source>It wrote no output; the computer may be out of memory.</source><translation>出力はありません。メモリ不足の可能性があります。</translation></message>
  <message><source>No partial files are left.</source><translation>書きかけのファイルは残っていません。</translation></message>
  <message><source>Nothing was run.</source><translation>何も実行していません。</translation></message>
  <message><source>See its last lines in the log. Products of an earlier run are unchanged.</source><translation>最後の出力をログで確認してください。以前の成果物は変更されていません。</translation></message>
  <message><source>Sessions cannot be run; existing results can still be opened.</source><translation>セッションは実行できませんが、既存の結果は開けます。</translation></message>
  <message><source>Test it in Settings › Options › furrowmap.</source><translation>「設定 › オプション › furrowmap」でテストしてください。</translation></message>
  <message><source>The run failed; see the log.</source><translation>実行に失敗しました。ログを見てください。</translation></message>
  <message><source>The worker ended without an answer (status {status}, at: {stage}).</source><translation>ワーカーが応答せずに終了しました（終了コード {status}、処理中：{stage}）。</translation></message>
  <message><source>The worker sent nothing for {minutes:.0f} minutes (at: {stage}).</source><translation>ワーカーが {minutes:.0f} 分間応答しません（処理中：{stage}）。</translation></message>
  <message><source>Try again without the file that it was reading, or inspect that file first.</source><translation>読み込み中だったファイルを除いて再実行するか、先にそのファイルを調べてください。</translation></message>
  <message><source>Update the older one: the plugin in QGIS's plugin manager, or furrowmap in its environment.</source><translation>古いほうを更新してください。プラグインは QGIS の「プラグインの管理とインストール」で、furrowmap はその環境で更新します。</translation></message>
  <message><source>furrowmap {version} has protocol version {found}; this plugin needs version {own}.</source><translation>furrowmap {version} のプロトコルはバージョン {found} ですが、このプラグインにはバージョン {own} が必要です。</translation></message>
  <message><source>the start</source><translation>開始</translation></message>
  <message><source>{program} could not be started: {reason}.</source><translation>{program} を起動できませんでした：{reason}。</translation></message>
  <message><source>{program} did not answer within {seconds:.0f} s.</source><translation>{program} が {seconds:.0f} 秒以内に応答しませんでした。</translation></message>
</context>
</TS>
