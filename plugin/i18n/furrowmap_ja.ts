<?xml version="1.0" encoding="utf-8"?>
<!DOCTYPE TS>
<TS version="2.1" language="ja">
<context>
  <name>Algorithms</name>
  <message>
    <source>A .tif or a .vrt.</source>
    <translation>.tif または .vrt。</translation>
  </message>
  <message>
    <source>A COPC file, whose name ends in .copc.laz.</source>
    <translation>名前が .copc.laz で終わる COPC ファイル。</translation>
  </message>
  <message>
    <source>A box, from a layer, the map, or by coordinates.</source>
    <translation>範囲。レイヤ、地図、または座標で指定します。</translation>
  </message>
  <message>
    <source>A line each: its identity, or how that begins, or its name.</source>
    <translation>1 行に 1 つ。識別子（先頭の一部でも可）またはセッション名。</translation>
  </message>
  <message>
    <source>A row for each point, with its errors.</source>
    <translation>点ごとに 1 行、誤差とともに書き出します。</translation>
  </message>
  <message>
    <source>Accuracy</source>
    <translation>精度</translation>
  </message>
  <message>
    <source>Accuracy of the survey (m)</source>
    <translation>測量の精度（m）</translation>
  </message>
  <message>
    <source>Add results to the base map</source>
    <translation>結果をベースマップに追加</translation>
  </message>
  <message>
    <source>Adds them to the project when the work is done.</source>
    <translation>処理が終わったらプロジェクトに追加します。</translation>
  </message>
  <message>
    <source>An address such as postgresql://me@server/farm. Passwords belong into PostgreSQL's own files.</source>
    <translation>postgresql://me@server/farm のような接続先。パスワードは PostgreSQL 自身の設定ファイルに置いてください。</translation>
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
    <source>Base map</source>
    <translation>ベースマップ</translation>
  </message>
  <message>
    <source>Base map (GeoPackage)</source>
    <translation>ベースマップ（GeoPackage）</translation>
  </message>
  <message>
    <source>Base map in PostGIS instead</source>
    <translation>代わりに PostGIS のベースマップ</translation>
  </message>
  <message>
    <source>Begin a session</source>
    <translation>セッションの作成</translation>
  </message>
  <message>
    <source>CRS of a new base map</source>
    <translation>新しいベースマップの CRS</translation>
  </message>
  <message>
    <source>CRS of clouds that state none</source>
    <translation>CRS の記載がない点群の CRS</translation>
  </message>
  <message>
    <source>CRS of the clean cloud</source>
    <translation>整えた点群の座標参照系</translation>
  </message>
  <message>
    <source>CRS of the map</source>
    <translation>地図の CRS</translation>
  </message>
  <message>
    <source>CRS of the points</source>
    <translation>測量点の CRS</translation>
  </message>
  <message>
    <source>CRS of the raster</source>
    <translation>ラスタの CRS</translation>
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
    <source>Captures, bags, GNSS logs, trajectories, clouds.</source>
    <translation>LiDAR の記録、bag、GNSS ログ、軌跡、点群。</translation>
  </message>
  <message>
    <source>Cell (m)</source>
    <translation>セル（m）</translation>
  </message>
  <message>
    <source>Check with surveyed points</source>
    <translation>測量点による検証</translation>
  </message>
  <message>
    <source>Choose either a GeoPackage or a PostGIS database.</source>
    <translation>GeoPackage か PostGIS データベースのどちらか一方を選んでください。</translation>
  </message>
  <message>
    <source>Choose either a file as the reference, or a known point.</source>
    <translation>基準にするファイルか既知点のどちらか一方を選んでください。</translation>
  </message>
  <message>
    <source>Classes: {text} are not numbers with commas between them.</source>
    <translation>クラス: {text} は、コンマで区切った番号ではありません。</translation>
  </message>
  <message>
    <source>Clean cloud</source>
    <translation>整えた点群</translation>
  </message>
  <message>
    <source>Clean point clouds</source>
    <translation>点群を整える</translation>
  </message>
  <message>
    <source>Clockwise from grid north: random roughness is then told without the marks of the tool.</source>
    <translation>座標北から時計回り。作業機の跡を除いたランダム粗さを求めます。</translation>
  </message>
  <message>
    <source>Cloud or surface</source>
    <translation>点群またはサーフェス</translation>
  </message>
  <message>
    <source>Clouds</source>
    <translation>点群</translation>
  </message>
  <message>
    <source>Clouds that state theirs keep it.</source>
    <translation>CRS の記載がある点群はそのまま使います。</translation>
  </message>
  <message>
    <source>Compares a cloud or a surface with surveyed points. RMSE after the ASPRS Positional Accuracy Standards, Edition 2 (2023), with the points' own accuracy included.</source>
    <translation>点群またはサーフェスを測量点と比べます。RMSE は ASPRS Positional Accuracy Standards 第 2 版（2023）により、測量点自体の精度を含みます。</translation>
  </message>
  <message>
    <source>Compares the positions in a GNSS log with those of a reference at the same instants: average, standard deviation and RMSE in 3D, 2D, X, Y and Z, of all epochs and by kind of fix.</source>
    <translation>GNSS ログの位置を、同じ時刻の基準の位置と比べます。3D、2D、X、Y、Z の平均、標準偏差、RMSE を、全エポックと測位状態ごとに求めます。</translation>
  </message>
  <message>
    <source>Computes the georeferenced point cloud of the recording that a session describes, sees in the scans whether the implement was in the ground, and writes the ground worked, surfaces and a report.</source>
    <translation>セッションに記述された記録から、位置の付いた点群を計算します。作業機が土に入っていたかをスキャンから判定し、作業した範囲、サーフェス、レポートを書き出します。</translation>
  </message>
  <message>
    <source>Computes what a machine worked in each field from its own log, ISO 11783-10 task data, without a scanner: passes, overlaps, strips missed and their areas.</source>
    <translation>スキャナを使わず、機械自身のログ（ISO 11783-10 作業データ）から、圃場ごとに作業した範囲を計算します。行程、重複、作業残しとそれぞれの面積が得られます。</translation>
  </message>
  <message>
    <source>Coordinates of a session</source>
    <translation>セッションの座標</translation>
  </message>
  <message>
    <source>Date of the first position</source>
    <translation>最初の測位の日付</translation>
  </message>
  <message>
    <source>Diameter of the discs (m)</source>
    <translation>円板の直径（m）</translation>
  </message>
  <message>
    <source>Direction of tillage (°)</source>
    <translation>耕うんの方向（°）</translation>
  </message>
  <message>
    <source>Discs around the points</source>
    <translation>測量点の円板（標的）</translation>
  </message>
  <message>
    <source>Epochs of the reference</source>
    <translation>基準のエポック</translation>
  </message>
  <message>
    <source>Estimates from the recording itself how the scanner is mounted and how its clock lies to that of the GNSS receiver: the ground is level on the mean of a session, and ground seen twice lies in one place.</source>
    <translation>スキャナの取り付け角度と、GNSS 受信機に対する時計のずれを、記録そのものから推定します。セッション全体で平均すると地面は水平であること、二度計測した地面は同じ位置にあることを使います。</translation>
  </message>
  <message>
    <source>Evaluate a GNSS log</source>
    <translation>GNSS ログの評価</translation>
  </message>
  <message>
    <source>Exchange</source>
    <translation>データ交換</translation>
  </message>
  <message>
    <source>Field, drive and sensors. Left out: a small field that is tilled for a minute.</source>
    <translation>圃場、走行、センサの設定。省略時：小さな圃場を 1 分間耕うんする例。</translation>
  </message>
  <message>
    <source>Figures by field (JSON)</source>
    <translation>圃場ごとの集計（JSON）</translation>
  </message>
  <message>
    <source>File or folder to write</source>
    <translation>書き出すファイルまたはフォルダ</translation>
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
    <source>Fill gaps up to (m)</source>
    <translation>欠損を埋める距離の上限（m）</translation>
  </message>
  <message>
    <source>Findings (JSON)</source>
    <translation>調査結果（JSON）</translation>
  </message>
  <message>
    <source>Folder for the evaluation</source>
    <translation>評価結果のフォルダ</translation>
  </message>
  <message>
    <source>Folder for the products</source>
    <translation>成果物のフォルダ</translation>
  </message>
  <message>
    <source>Folder for the recording</source>
    <translation>記録のフォルダ</translation>
  </message>
  <message>
    <source>Folder for the surfaces</source>
    <translation>サーフェスのフォルダ</translation>
  </message>
  <message>
    <source>Folder of the products</source>
    <translation>成果物のフォルダ</translation>
  </message>
  <message>
    <source>Folder of the recording</source>
    <translation>記録のフォルダ</translation>
  </message>
  <message>
    <source>Folder of the surfaces</source>
    <translation>サーフェスのフォルダ</translation>
  </message>
  <message>
    <source>Format</source>
    <translation>形式</translation>
  </message>
  <message>
    <source>Forward, left, up: from the reference's antenna to that of the log, on one vehicle.</source>
    <translation>前、左、上の順。同じ車両上で、基準のアンテナからログのアンテナまで。</translation>
  </message>
  <message>
    <source>Found out</source>
    <translation>分かったこと</translation>
  </message>
  <message>
    <source>From heights seen around them; nothing is filled outside.</source>
    <translation>周囲で計測した高さから補います。外側は埋めません。</translation>
  </message>
  <message>
    <source>Ground becomes class 2, all but noise and the machine class 1. none: classes stay as they are.</source>
    <translation>地面はクラス 2、ノイズと機械を除くほかの点はクラス 1 になります。none: クラスはそのまま残ります。</translation>
  </message>
  <message>
    <source>Ground is told by</source>
    <translation>地面の判定方法</translation>
  </message>
  <message>
    <source>Height of a cell</source>
    <translation>セルの高さ</translation>
  </message>
  <message>
    <source>How they are told: by their number in a radius, or by their distance to the next ones.</source>
    <translation>判定方法：半径内の点の数、または近くの点までの距離。</translation>
  </message>
  <message>
    <source>In metres. Left out: that of the clouds.</source>
    <translation>メートル単位の CRS。省略時：点群の CRS。</translation>
  </message>
  <message>
    <source>In seconds: the track and a coarse surface of few scans, neither matched nor searched for the implement. Products of a run stay as they are.</source>
    <translation>数秒で、軌跡と、少数のスキャンによる粗い地表面だけを作ります。スキャンの照合も作業機の検出も行いません。処理済みの成果はそのまま残ります。</translation>
  </message>
  <message>
    <source>Inspect recordings</source>
    <translation>記録を調べる</translation>
  </message>
  <message>
    <source>Instead of the cells of the latest session.</source>
    <translation>最新のセッションのセルの代わりに平均を使います。</translation>
  </message>
  <message>
    <source>Interpolate across at most (s)</source>
    <translation>補間する最大の間隔（秒）</translation>
  </message>
  <message>
    <source>Its id or name.</source>
    <translation>作業の ID または名前。</translation>
  </message>
  <message>
    <source>Its other lines stay as they are.</source>
    <translation>ほかの行はそのまま残ります。</translation>
  </message>
  <message>
    <source>LAS, LAZ or COPC files in one CRS.</source>
    <translation>同じ座標参照系の LAS、LAZ、COPC ファイル。</translation>
  </message>
  <message>
    <source>LAS, LAZ or COPC files; together they lie on one grid.</source>
    <translation>LAS、LAZ、COPC のファイル。まとめて 1 つの格子にします。</translation>
  </message>
  <message>
    <source>LAS, LAZ, COPC or GeoTIFF.</source>
    <translation>LAS、LAZ、COPC、または GeoTIFF。</translation>
  </message>
  <message>
    <source>Leave noise out</source>
    <translation>ノイズを除く</translation>
  </message>
  <message>
    <source>Leave out points that are alone</source>
    <translation>孤立した点を除く</translation>
  </message>
  <message>
    <source>Left out: all that the result has.</source>
    <translation>省略時：結果にあるすべて。</translation>
  </message>
  <message>
    <source>Left out: beside the result. Formats that hold one layer a file give a folder.</source>
    <translation>省略時：結果の隣。1 ファイルに 1 レイヤの形式ではフォルダになります。</translation>
  </message>
  <message>
    <source>Left out: not known, or not required.</source>
    <translation>省略時：不明、または要求なし。</translation>
  </message>
  <message>
    <source>Left out: one that fits the place.</source>
    <translation>省略時：その場所に合うもの。</translation>
  </message>
  <message>
    <source>Left out: session.toml beside the recordings.</source>
    <translation>省略時：記録の隣の session.toml。</translation>
  </message>
  <message>
    <source>Left out: that of the first session.</source>
    <translation>省略時：最初のセッションの CRS。</translation>
  </message>
  <message>
    <source>Left out: that of the session.</source>
    <translation>省略時：セッションの CRS。</translation>
  </message>
  <message>
    <source>Left out: that of the surfaces.</source>
    <translation>省略時：サーフェスと同じ。</translation>
  </message>
  <message>
    <source>Left out: the widest that the logs show.</source>
    <translation>省略時：ログに現れる最大の幅。</translation>
  </message>
  <message>
    <source>LiDAR captures or bags, GNSS logs, trajectories of one drive.</source>
    <translation>1 回の走行の LiDAR の記録や bag、GNSS ログ、軌跡。</translation>
  </message>
  <message>
    <source>List the sessions of the base map</source>
    <translation>ベースマップのセッション一覧</translation>
  </message>
  <message>
    <source>Log to evaluate</source>
    <translation>評価するログ</translation>
  </message>
  <message>
    <source>Looked for by this, for the horizontal error.</source>
    <translation>水平誤差を求めるため、これを手がかりに円板を探します。</translation>
  </message>
  <message>
    <source>Looks at recordings and writes a commented session.toml with what it could find out. What the recordings do not say, such as how the sensor is mounted, stands in it as a comment, and is told.</source>
    <translation>記録を調べ、分かったことを注釈付きの session.toml に書き出します。センサの取り付け位置など、記録からは分からないことは注釈として残し、お知らせします。</translation>
  </message>
  <message>
    <source>Makes one COPC file of LAS, LAZ or COPC clouds, from furrowmap or from anybody else: points that are alone are told as noise, the ground is told, and the cloud is thinned, as far as each is asked for. Memory does not grow with the land.</source>
    <translation>furrowmap やほかのソフトウェアの LAS、LAZ、COPC 点群から、一つの COPC ファイルを作ります。指定に応じて、孤立した点をノイズとし、地面を分類し、点群を間引きます。メモリの使用量は土地の広さによって増えません。</translation>
  </message>
  <message>
    <source>Makes surfaces of LAS, LAZ or COPC clouds, from furrowmap or from anybody else: heights of all points (DSM) and of the ground (DTM), height above ground, hillshade, slope, roughness, and low spots that hold water. Memory does not grow with the land.</source>
    <translation>LAS、LAZ、COPC の点群（furrowmap のものでもほかのものでも）からサーフェスを作ります。全点の高さ（DSM）、地面の高さ（DTM）、地上高、陰影、傾斜、粗さ、水のたまる窪地です。土地が広くてもメモリの使用量は増えません。</translation>
  </message>
  <message>
    <source>Mean of all sessions</source>
    <translation>全セッションの平均</translation>
  </message>
  <message>
    <source>Meets what is required</source>
    <translation>要求を満たす</translation>
  </message>
  <message>
    <source>More than 1 for a quick look.</source>
    <translation>2 以上にすると、すばやく概略を見られます。</translation>
  </message>
  <message>
    <source>Mosaic</source>
    <translation>モザイク</translation>
  </message>
  <message>
    <source>Mosaic of the base map's surfaces</source>
    <translation>ベースマップのサーフェスのモザイク</translation>
  </message>
  <message>
    <source>NMEA, or another log that 'Inspect recordings' knows.</source>
    <translation>NMEA、または「記録を調べる」で読めるログ。</translation>
  </message>
  <message>
    <source>Not known from the recordings</source>
    <translation>記録からは分からないこと</translation>
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
    <source>Number of surfaces</source>
    <translation>サーフェスの数</translation>
  </message>
  <message>
    <source>Number removed</source>
    <translation>取り除いた数</translation>
  </message>
  <message>
    <source>Numbers with commas between them, such as 2,9. Left out: all but noise.</source>
    <translation>2,9 のようにコンマ区切りの番号。省略時：ノイズ以外のすべて。</translation>
  </message>
  <message>
    <source>Numbers with commas between them; 64,65 is the machine in furrowmap's own clouds.</source>
    <translation>コンマで区切った番号。furrowmap の点群では 64,65 が機械です。</translation>
  </message>
  <message>
    <source>Of an antenna at rest: latitude, longitude, height, with commas between them.</source>
    <translation>静止したアンテナの緯度、経度、高さ（コンマ区切り）。</translation>
  </message>
  <message>
    <source>On the command line:</source>
    <translation>コマンドライン：</translation>
  </message>
  <message>
    <source>One point in each cube of (m)</source>
    <translation>立方体ごとに一点（一辺、m）</translation>
  </message>
  <message>
    <source>Only a preview</source>
    <translation>プレビューのみ</translation>
  </message>
  <message>
    <source>Only classes</source>
    <translation>使うクラス</translation>
  </message>
  <message>
    <source>Only layers</source>
    <translation>書き出すレイヤ</translation>
  </message>
  <message>
    <source>Only the task</source>
    <translation>対象の作業</translation>
  </message>
  <message>
    <source>Only within</source>
    <translation>対象範囲</translation>
  </message>
  <message>
    <source>Open the products, styled</source>
    <translation>成果物をスタイル付きで開く</translation>
  </message>
  <message>
    <source>Or a known point</source>
    <translation>または既知点</translation>
  </message>
  <message>
    <source>Or a known point: {text} is not latitude, longitude, height.</source>
    <translation>または既知点：{text} は「緯度, 経度, 高さ」になっていません。</translation>
  </message>
  <message>
    <source>Otherwise they are transformed.</source>
    <translation>指定しない場合は座標変換します。</translation>
  </message>
  <message>
    <source>Otherwise what is there is kept, and nothing is done.</source>
    <translation>指定しない場合、既存のものを残し、何も行いません。</translation>
  </message>
  <message>
    <source>Page to read (HTML)</source>
    <translation>閲覧用ページ（HTML）</translation>
  </message>
  <message>
    <source>Pass results on</source>
    <translation>結果の受け渡し</translation>
  </message>
  <message>
    <source>Points of classes 7 and 18 of the clouds as well. Otherwise noise stays, as class 7.</source>
    <translation>元の点群のクラス 7 と 18 の点も除きます。指定しなければ、ノイズはクラス 7 として残ります。</translation>
  </message>
  <message>
    <source>Points that are alone become noise</source>
    <translation>孤立した点をノイズとする</translation>
  </message>
  <message>
    <source>Products of the same session in it are replaced.</source>
    <translation>同じセッションの成果物は置き換えられます。</translation>
  </message>
  <message>
    <source>Puts the results of runs into a farm's base map, a GeoPackage or a PostGIS database, which is made where it is not there. A session that it has already is replaced by its new result. Either all get into it, or it stays as it was.</source>
    <translation>実行結果を農場のベースマップ（GeoPackage または PostGIS データベース）に入れます。ベースマップがなければ作ります。すでにあるセッションは新しい結果に置き換えます。すべてが入るか、元のままかのどちらかです。</translation>
  </message>
  <message>
    <source>Puts the surfaces of the sessions in a base map into one raster. The latest session wins where they overlap. A .vrt is a small file that refers to the surfaces where they lie; a .tif is a cloud-optimised GeoTIFF with all their bands.</source>
    <translation>ベースマップにあるセッションのサーフェスを 1 つのラスタにまとめます。重なる所では最新のセッションを優先します。.vrt は元のサーフェスを参照する小さなファイル、.tif は全バンドを含むクラウド最適化 GeoTIFF です。</translation>
  </message>
  <message>
    <source>Recordings</source>
    <translation>記録</translation>
  </message>
  <message>
    <source>Reference</source>
    <translation>基準</translation>
  </message>
  <message>
    <source>Refuse sessions of another CRS</source>
    <translation>CRS の異なるセッションを受け付けない</translation>
  </message>
  <message>
    <source>Remove sessions from the base map</source>
    <translation>ベースマップからセッションを取り除く</translation>
  </message>
  <message>
    <source>Replace a session file that is there</source>
    <translation>既存のセッションファイルを置き換える</translation>
  </message>
  <message>
    <source>Replace an earlier evaluation</source>
    <translation>以前の評価を置き換える</translation>
  </message>
  <message>
    <source>Replace earlier surfaces</source>
    <translation>以前のサーフェスを置き換える</translation>
  </message>
  <message>
    <source>Replace products of another session</source>
    <translation>別のセッションの成果物を置き換える</translation>
  </message>
  <message>
    <source>Replace the file</source>
    <translation>ファイルを置き換える</translation>
  </message>
  <message>
    <source>Replace what is in the folder</source>
    <translation>フォルダの中身を置き換える</translation>
  </message>
  <message>
    <source>Replace what is there</source>
    <translation>既存のものを置き換える</translation>
  </message>
  <message>
    <source>Report to read (HTML)</source>
    <translation>レポート（HTML）</translation>
  </message>
  <message>
    <source>Required horizontal RMSE (m)</source>
    <translation>要求する水平 RMSE（m）</translation>
  </message>
  <message>
    <source>Required vertical RMSE (m)</source>
    <translation>要求する鉛直 RMSE（m）</translation>
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
    <source>Says what a run will do to a session's coordinates, with figures at the site: frame and epoch, how far positions are moved, the geoid's height, grid convergence and scale. Nothing is written.</source>
    <translation>実行するとセッションの座標がどうなるかを、その場所での数値で示します：基準系とエポック、位置の移動量、ジオイド高、子午線収差と縮尺係数。何も書き出しません。</translation>
  </message>
  <message>
    <source>Says what recordings are and hold: model, points, span, clocks and how they disagree, fixes.</source>
    <translation>記録の種類と内容を調べます：機種、点数、期間、時計とそのずれ、測位状態。</translation>
  </message>
  <message>
    <source>Scenario</source>
    <translation>シナリオ</translation>
  </message>
  <message>
    <source>Schema in PostGIS</source>
    <translation>PostGIS のスキーマ</translation>
  </message>
  <message>
    <source>Session</source>
    <translation>セッション</translation>
  </message>
  <message>
    <source>Session file</source>
    <translation>セッションファイル</translation>
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
    <source>Side of a cell. Left out: the least round one with four points in it.</source>
    <translation>セルの一辺。省略時：1 セルに 4 点が入る最小の切りのよい値。</translation>
  </message>
  <message>
    <source>Simulate a recording</source>
    <translation>記録のシミュレーション</translation>
  </message>
  <message>
    <source>Steps of the reference. Left out: 1.5 of its intervals.</source>
    <translation>基準の間隔。省略時：測位間隔の 1.5 倍。</translation>
  </message>
  <message>
    <source>Stopped before the end; nothing half-written is left.</source>
    <translation>途中で止めました。書きかけのものは残っていません。</translation>
  </message>
  <message>
    <source>Surface</source>
    <translation>サーフェス</translation>
  </message>
  <message>
    <source>Surfaces and clouds</source>
    <translation>サーフェスと点群</translation>
  </message>
  <message>
    <source>Surfaces of point clouds</source>
    <translation>点群のサーフェス</translation>
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
    <source>Table of the points</source>
    <translation>測量点の表</translation>
  </message>
  <message>
    <source>Take every n-th point</source>
    <translation>n 点ごとに使う</translation>
  </message>
  <message>
    <source>Takes cloud-optimised GeoTIFFs and surfaces.json.</source>
    <translation>クラウド最適化 GeoTIFF と surfaces.json が入ります。</translation>
  </message>
  <message>
    <source>Takes evaluation.json, a page to read, and a table of the epochs.</source>
    <translation>evaluation.json、閲覧用ページ、エポックの表が入ります。</translation>
  </message>
  <message>
    <source>Takes passes, overlaps and misses of all fields.</source>
    <translation>全圃場の行程、重複、作業残しが入ります。</translation>
  </message>
  <message>
    <source>Takes recording, session and truth.</source>
    <translation>記録、セッション、真値が入ります。</translation>
  </message>
  <message>
    <source>Takes sessions out of a base map. The folders of their results stay as they are.</source>
    <translation>セッションをベースマップから取り除きます。結果のフォルダはそのまま残ります。</translation>
  </message>
  <message>
    <source>Task data</source>
    <translation>作業データ</translation>
  </message>
  <message>
    <source>Tells the days, such as Asia/Tokyo. Left out: by the longitude.</source>
    <translation>日付の区切りに使います（例：Asia/Tokyo）。省略時：経度から決めます。</translation>
  </message>
  <message>
    <source>Tells which sessions are in a base map: identity, day, ground worked, name.</source>
    <translation>ベースマップにあるセッションの識別子、日付、作業面積、名前を示します。</translation>
  </message>
  <message>
    <source>The farm's GeoPackage.</source>
    <translation>農場の GeoPackage。</translation>
  </message>
  <message>
    <source>The one nearest to its middle. Left out: all points.</source>
    <translation>中心に最も近い点です。省略時: すべての点。</translation>
  </message>
  <message>
    <source>The report.json of each run, which stands for its folder.</source>
    <translation>各実行の report.json。そのフォルダを表します。</translation>
  </message>
  <message>
    <source>The session.toml beside the recording.</source>
    <translation>記録の隣にある session.toml。</translation>
  </message>
  <message>
    <source>The session.toml beside the recording; 'Begin a session' writes one.</source>
    <translation>記録の隣にある session.toml。「セッションの作成」で作れます。</translation>
  </message>
  <message>
    <source>Time zone</source>
    <translation>タイムゾーン</translation>
  </message>
  <message>
    <source>UTC, as YYYY-MM-DD, for logs without dates.</source>
    <translation>UTC、YYYY-MM-DD 形式。日付のないログに使います。</translation>
  </message>
  <message>
    <source>Used only where discs are looked for.</source>
    <translation>円板を探すときだけ使います。</translation>
  </message>
  <message>
    <source>Where the tables lie in the database.</source>
    <translation>データベースの中でテーブルを置く場所。</translation>
  </message>
  <message>
    <source>Where their file states none. Left out: that of the product.</source>
    <translation>ファイルに記載がない場合。省略時：点群・サーフェスの CRS。</translation>
  </message>
  <message>
    <source>Without classes</source>
    <translation>除くクラス</translation>
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
    <source>Working width (m)</source>
    <translation>作業幅（m）</translation>
  </message>
  <message>
    <source>Write what was found into the session</source>
    <translation>求めた値をセッションに書き込む</translation>
  </message>
  <message>
    <source>Writes the result of a run in the format of another program: GeoPackage, GeoParquet, FlatGeobuf, GeoJSON, Shapefile, KML, CSV, ISO 11783-10 task data for farm software and terminals, or a STAC catalogue over many runs. GeoJSON and KML are always in WGS 84.</source>
    <translation>実行結果をほかのソフトウェアの形式で書き出します：GeoPackage、GeoParquet、FlatGeobuf、GeoJSON、Shapefile、KML、CSV、営農ソフトやターミナル用の ISO 11783-10 作業データ、多数の結果をまとめる STAC カタログ。GeoJSON と KML は常に WGS 84 です。</translation>
  </message>
  <message>
    <source>Writes what a tractor's recorder would have written: the LiDAR's packets, the GNSS log, a session and the field's boundary, with the truth beside them. To learn with, and to choose where a sensor goes.</source>
    <translation>トラクタの記録装置が残すはずのもの（LiDAR のパケット、GNSS ログ、セッション、圃場の境界）を真値とともに書き出します。使い方を学ぶときや、センサの取り付け位置を選ぶときに使います。</translation>
  </message>
  <message>
    <source>Written into the session</source>
    <translation>セッションに書き込み済み</translation>
  </message>
  <message>
    <source>auto: by the clouds' own classes where they have them, else by the SMRF filter.</source>
    <translation>auto：点群自身のクラスがあればそれを、なければ SMRF フィルタを使います。</translation>
  </message>
  <message>
    <source>dsm: as left; dsm_before: before the tool came; change: the difference.</source>
    <translation>dsm：作業後、dsm_before：作業前、change：その差。</translation>
  </message>
  <message>
    <source>fixed: leave out those at which the reference is not fixed.</source>
    <translation>fixed：基準が FIX 解でないエポックを除きます。</translation>
  </message>
  <message>
    <source>furrowmap's worker is not set up: Settings › Options › furrowmap makes or finds its environment.</source>
    <translation>furrowmap のワーカーが設定されていません。「設定 › オプション › furrowmap」で環境を作るか、選んでください。</translation>
  </message>
  <message>
    <source>isoxml is task data as a folder, or a .zip if the target ends so; stac takes many results.</source>
    <translation>isoxml は作業データのフォルダ（書き出し先が .zip なら .zip）。stac は多数の結果をまとめます。</translation>
  </message>
  <message>
    <source>median, trimmed, mean, min, max, or a percentile such as p90.</source>
    <translation>median（中央値）、trimmed（刈込平均）、mean（平均）、min、max、または p90 のようなパーセンタイル。</translation>
  </message>
  <message>
    <source>{parameter}: there is no {path}.</source>
    <translation>{parameter}：{path} がありません。</translation>
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
