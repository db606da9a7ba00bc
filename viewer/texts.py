"""The words of the pages, in English and Japanese; joints and takes keep their names."""

from collections.abc import Mapping

LANGUAGES = ("en", "ja")

_TEXTS: dict[str, tuple[str, str]] = {
    # every page
    "site": ("Dance archive", "舞踊アーカイブ"),
    "browse": ("Browse", "一覧"),
    "search": ("Search", "検索"),
    "body_model": ("Body model", "身体モデル"),
    "runs": ("Runs ↗", "実行 ↗"),
    "other_language": ("日本語", "English"),
    "theme": ("Light or dark", "明暗"),
    "fault": ("This cannot be shown: {why}", "表示できません: {why}"),
    "opening": ("Opening the archive …", "アーカイブを開いています …"),
    "empty_archive": (
        "This archive has no recordings yet. `shosa ingest` brings some in; then load this page "
        "again.",
        "まだ動作データがありません。`shosa ingest` で追加してから再読み込みしてください。",
    ),
    "left_out": (
        "This link has parts that mean nothing and were left out: {what}",
        "リンクの次の部分は無効なため無視しました: {what}",
    ),
    "unknown_take": (
        "There is no recording “{take}” here; another is shown.",
        "「{take}」という動作データはありません。別のものを表示します。",
    ),
    # recording and clip
    "step_recording": ("1 · Recording", "1 · 動作データ"),
    "step_clip": ("2 · Query clip", "2 · 質問区間"),
    "step_joints": ("3 · Compare which joints", "3 · 比べる関節"),
    "recording": ("Recording", "動作データ"),
    "filter": ("Type to filter: title, performer …", "題名・演者などで絞り込み"),
    "none_found": ("No recording has all these words.", "該当する動作データがありません。"),
    "more": ("… and {count} more: type to narrow", "… ほか {count} 件（入力して絞り込み）"),
    "about_take": ("{performer}{take} · {seconds} s", "{performer}{take} · {seconds} 秒"),
    "drop": (
        "or drop a motion file (BVH, C3D, TRC) on the page",
        "またはモーションファイル（BVH・C3D・TRC）をここへ",
    ),
    "choose_file": ("choose a file", "ファイルを選ぶ"),
    "reading_file": ("Reading {name} …", "{name} を読み込み中 …"),
    "a_file": ("file, not in the archive", "アーカイブ外のファイル"),
    "clip_start": ("Start of the clip", "区間の始まり"),
    "clip_end": ("End of the clip", "区間の終わり"),
    "frames": ("frames", "フレーム"),
    "seconds": ("s", "秒"),
    "clip_of": ("{seconds} s", "{seconds} 秒"),
    "drag": ("Drag the ends, or the clip itself.", "両端または区間全体をドラッグ。"),
    # parts and settings
    "part_whole": ("Whole body", "全身"),
    "part_upper": ("Upper body", "上半身"),
    "part_lower": ("Lower body", "下半身"),
    "part_arms": ("Arms", "両腕"),
    "part_right-arm": ("Right arm", "右腕"),
    "part_left-arm": ("Left arm", "左腕"),
    "part_legs": ("Legs", "両脚"),
    "part_right-leg": ("Right leg", "右脚"),
    "part_left-leg": ("Left leg", "左脚"),
    "part_feet": ("Feet", "足先"),
    "part_hands": ("Hands", "手先"),
    "part_head": ("Head", "頭"),
    "weights": ("Weights: {count} of 21 joints", "重み: 21 関節中 {count}"),
    "equal_weights": ("Reset to the part", "部位の重みに戻す"),
    "threshold": ("Threshold", "しきい値"),
    "threshold_off": ("any distance", "制限なし"),
    "threshold_means": (
        "up to {value}: joints {cm} cm apart on average, for a person of 1.6 m",
        "{value} まで: 身長 1.6 m で関節が平均 {cm} cm 離れる程度",
    ),
    "level_same": ("same", "同一"),
    "level_like": ("like", "類似"),
    "level_same_title": (
        "As near as the same dancer's same movement in another performance",
        "同じ踊り手が別の機会に踊った同じ動きと同程度の近さ",
    ),
    "level_like_title": (
        "As near as another dancer's same movement",
        "別の踊り手が踊った同じ動きと同程度の近さ",
    ),
    "one_in": ("1 in {count}", "{count} に 1"),
    "rarer_than_one_in": ("< 1 in {count}", "{count} に 1 未満"),
    "most": ("most", "多数"),
    "chance_title": (
        "How many of the archive's clips are so near by chance, moving otherwise",
        "別の動きなのに偶然これほど近い区間の割合（このアーカイブで測定）",
    ),
    "top": ("Show at most", "最大件数"),
    "mirror": ("Also mirrored (left and right exchanged)", "左右反転も探す"),
    "path_weight": ("Count where the dancer goes", "軌跡も比べる"),
    "search_button": ("Search the archive", "アーカイブを検索"),
    "searching": ("Searching {count} recordings …", "{count} 件を検索中 …"),
    # results
    "results": ("Results", "結果"),
    "before_search": (
        "Mark a few seconds of a recording, choose what to compare, and press Search: every place "
        "in the archive that moves like it is listed here, the nearest first.",
        "数秒の区間と比べる関節を選んで検索すると、似た動きが近い順にここに並びます。",
    ),
    "so_far": (
        "{matches} matches so far, {certain} of them certain",
        "これまでに {matches} 件、うち確定 {certain} 件",
    ),
    "summary": (
        "{matches} matches in {takes} recordings · {seconds} s",
        "{takes} 件の動作データに {matches} 件 · {seconds} 秒",
    ),
    "summary_none": ("No match · {seconds} s", "一致なし · {seconds} 秒"),
    "summary_one": ("1 match · {seconds} s", "1 件 · {seconds} 秒"),
    "searched": (
        "searched {takes} recordings, {frames} frames; the clip itself is left out",
        "{takes} 件 {frames} フレームを検索（質問区間自身は除く）",
    ),
    "outdated": (
        "The query has changed: press Search again.",
        "条件が変わりました。もう一度検索してください。",
    ),
    "nothing": (
        "Nothing moves so much like this clip. To find more: {advice}.",
        "似た動きは見つかりませんでした。{advice}。",
    ),
    "advice_threshold": (
        "raise the threshold or set it to “any distance”",
        "しきい値を上げるか「制限なし」にしてください",
    ),
    "advice_part": ("compare fewer joints", "比べる関節を減らしてください"),
    "advice_shorter": ("mark a shorter clip", "質問区間を短くしてください"),
    "advice_more": ("ingest more recordings", "動作データを増やしてください"),
    "advice_path": (
        "do not count where the dancer goes",
        "軌跡の比較を外してください",
    ),
    "loosen": ("Search up to {value}, where the nearest is", "最も近い {value} まで広げて検索"),
    "and": (", ", "、"),
    "skipped": ("{count} recordings were not compared", "{count} 件は比較できませんでした"),
    "mirrored": ("mirrored", "左右反転"),
    "report": ("Save as one page", "1 ページに保存"),
    "report_title": (
        "One HTML file with these matches, for a colleague: it plays without this archive",
        "検索結果を 1 つの HTML に保存（単独で再生できます）",
    ),
    # stage
    "stage": ("The dancers in three dimensions; drag to turn", "立体表示（ドラッグで回転）"),
    "arrangement": ("Arrangement", "並べ方"),
    "overlay": ("Overlay", "重ねる"),
    "side": ("Side by side", "並べる"),
    "query": ("Query only", "質問のみ"),
    "voxels": ("Filmed body", "ボクセル"),
    "off": ("off", "なし"),
    "as_filmed": ("as filmed", "撮影色"),
    "by_segment": ("by segment", "体節別"),
    "pinned": ("As compared", "比較の位置"),
    "pinned_title": (
        "On top of each other in every frame, as the search compares them; else only at the start",
        "検索と同じく毎フレーム位置と向きを合わせる。外すと最初だけ合わせる",
    ),
    "warped": ("Matched in time", "時間を合わせる"),
    "warped_title": (
        "Each moment of the query beside the moment of the match it was found with; else real time",
        "対応する時刻どうしを並べる。外すとそれぞれの実時間",
    ),
    "follow": ("Follow", "追う"),
    "front": ("Front", "正面"),
    "front_title": ("Look from the front again (F)", "正面に戻す (F)"),
    "film": ("Film", "動画"),
    "film_title": (
        "Play once and save what is on the stage as a film",
        "1 回再生して動画として保存",
    ),
    "filming": ("Filming …", "撮影中 …"),
    "no_film": ("This browser cannot save films.", "このブラウザでは動画を保存できません。"),
    "query_word": ("query", "質問"),
    "match_word": ("match", "結果"),
    "play": ("Play or pause", "再生・停止"),
    "play_title": ("Play or pause (space)", "再生・停止（スペース）"),
    "back": ("One frame back", "1 フレーム戻る"),
    "forth": ("One frame on", "1 フレーム進む"),
    "time": ("Time", "時間"),
    "speed": ("Speed", "速さ"),
    "loop": ("Loop", "繰り返し"),
    "readout": ("frame {frame} · {seconds} s", "フレーム {frame} · {seconds} 秒"),
    "readout_match": (" ↔ {frame}", " ↔ {frame}"),
    "no_webgl": (
        "This browser shows no 3-D graphics (WebGL is off), so flat figures are drawn.",
        "このブラウザでは WebGL が使えないため、平面図で表示しています。",
    ),
    "not_loaded": ("This could not be loaded: {why}", "読み込めませんでした: {why}"),
    # browse
    "recordings": ("{count} recordings", "動作データ {count} 件"),
    "filmed": ("filmed", "撮影"),
    "take": ("name", "名前"),
    "length": ("frames", "フレーム"),
    "made_from": ("from", "元データ"),
    "version": ("version", "版"),
    "stages": ("Stages", "処理段階"),
    "stage_silhouettes": ("silhouettes", "シルエット"),
    "stage_voxels": ("voxels", "ボクセル"),
    "stage_labels": ("labels", "体節ラベル"),
    "stage_body": ("body", "身体モデル"),
    "stage_pose": ("pose", "姿勢"),
    "stage_motion": ("motion", "動作データ"),
    "segment_Head": ("Head", "頭部"),
    "segment_Body": ("Body", "胴体"),
    "segment_Waist": ("Waist", "腰"),
    "segment_RUpperArm": ("Right upper arm", "右上腕"),
    "segment_RForeArm": ("Right forearm", "右前腕"),
    "segment_LUpperArm": ("Left upper arm", "左上腕"),
    "segment_LForeArm": ("Left forearm", "左前腕"),
    "segment_RUpperLeg": ("Right upper leg", "右大腿"),
    "segment_RLowerLeg": ("Right lower leg", "右下腿"),
    "segment_LUpperLeg": ("Left upper leg", "左大腿"),
    "segment_LLowerLeg": ("Left lower leg", "左下腿"),
    "missing": ("without {joints}", "欠けている関節: {joints}"),
    "doubtful": ("Doubtful frames: {count}", "疑わしいフレーム: {count}"),
    "go_on": ("Go on", "次に"),
    "search_like": ("Search with this", "これで検索"),
    "correct_body": ("Correct the body model", "身体モデルを直す"),
    "said": ("What was said when it was made", "作成時の記録"),
    "nothing_said": ("Nothing was inferred or left out.", "補った点や除いた点はありません。"),
    "edit": ("Edit", "編集"),
    "edit_title": ("What describes this recording", "この動作データの説明"),
    "field_title": ("title", "題名"),
    "field_performer": ("performer", "演者"),
    "field_recorded": ("recorded", "収録日"),
    "field_creator": ("creator", "作成者"),
    "field_contributor": ("contributor", "協力者"),
    "field_date": ("date", "日付"),
    "field_description": ("description", "説明"),
    "field_subject": ("subject", "主題"),
    "field_rights": ("rights", "権利"),
    "field_language": ("language", "言語"),
    "new_field": ("another field", "項目を追加"),
    "save": ("Save", "保存"),
    "cancel": ("Cancel", "取消"),
    "words_only": (
        "The dance itself stays as it is; empty a field to remove it.",
        "動作データ自体は変わりません。空にすると項目を削除します。",
    ),
    "changed_meanwhile": (
        "Somebody else has changed this recording since you opened it, and nothing was saved. "
        "Load the page again to see what it says now.",
        "開いてから他の人が変更したため、保存しませんでした。再読み込みして確認してください。",
    ),
    "its_runs": ("How it was made ↗", "処理の記録 ↗"),
    "save_as": ("Save as a file", "ファイルに保存"),
    "save_view": ("picture from here (PNG)", "この視点の画像 (PNG)"),
    "save_view_title": (
        "The filmed body in this frame, from where you look at it now",
        "このフレームのボクセルを今の視点から描いた画像",
    ),
    "save_voxels": ("colored voxels (GLB)", "色付きボクセル (GLB)"),
    "save_voxels_title": (
        "The filmed body from this frame on, {count} frames at most, for any 3-D viewer",
        "このフレームから最大 {count} フレームのボクセル（一般の 3D ビューア用）",
    ),
    "films": ("Films", "撮影動画"),
    "opening_films": ("Looking through the films …", "動画を確認中 …"),
    "camera": ("Camera", "カメラ"),
    "all_cameras": ("all cameras", "全カメラ"),
    # body model
    "none_filmed": (
        "No recording of this archive was filmed: there are no voxels to measure a body in.",
        "撮影された動作データがないため、ボクセルがありません。",
    ),
    "no_voxels": (
        "The recording “{take}” was not filmed and has no voxels; choose one that was.",
        "「{take}」は撮影されていないためボクセルがありません。",
    ),
    "from_side": ("Side", "横"),
    "from_back": ("Back", "背面"),
    "to_move": ("What to move", "動かすもの"),
    "joints": ("Joints", "関節"),
    "boundaries": ("Boundaries", "境界"),
    "brush": ("Brush", "ブラシ"),
    "brush_size": ("Size", "太さ"),
    "how_brush": (
        "Choose a segment here, then paint the body where it should be; drag beside it to turn.",
        "体節を選んで身体の上を塗ります。身体の外をドラッグすると回転します。",
    ),
    "undo": ("Undo", "元に戻す"),
    "frame": ("Frame", "フレーム"),
    "start_file": ("These joints were placed by a person before.", "以前に人が置いた関節です。"),
    "start_body": ("The joints were found for you.", "関節は自動で求めたものです。"),
    "start_track": (
        "The joints are those of the fitted pose in this frame.",
        "このフレームの姿勢推定による関節です。",
    ),
    "start_standing": (
        "A standing body is the beginning: drag every joint to its place.",
        "直立の初期位置です。各関節を正しい位置へ動かしてください。",
    ),
    "how_joints": (
        "Drag any that is off, in front and side view; the colors follow.",
        "ずれているものを正面と横から動かすと、色分けが変わります。",
    ),
    "how_boundaries": (
        "Drag a square to move the border between two segments; the joint stays.",
        "四角を動かすと体節の境界だけが動きます（関節は動きません）。",
    ),
    "both_sides": ("Move left and right together", "左右を同時に動かす"),
    "captured_colors": ("Show captured colors", "撮影色で表示"),
    "use_model": ("Use this body model", "この身体モデルを使う"),
    "download_model": ("Download initial.json", "initial.json を保存"),
    "model_saved": ("Saved as {path}.", "{path} に保存しました。"),
    "digitize": ("Digitize with it now", "これで再処理する"),
    "then_run": ("It runs for minutes, as this does:", "数分かかります。次のコマンドと同じです:"),
    "digitized": (
        "Digitized: the recording has a new version.",
        "再処理が完了し、新しい版ができました。",
    ),
    "not_digitized": ("It did not finish: {said}", "完了しませんでした: {said}"),
    "no_capture": (
        "The capture is not on this machine: download the file and put it into its folder.",
        "元の撮影データがこの計算機にないため、ファイルを保存してそのフォルダへ置いてください。",
    ),
    # report
    "settings": ("compared", "設定"),
    "archive": ("archive", "アーカイブ"),
    "searched_word": ("searched recordings", "検索対象"),
    "versions": ("versions of the recordings", "動作データの版"),
    "made_by": ("made by", "作成"),
    "no_match": ("Nothing was found.", "見つかりませんでした。"),
    # curves
    "curves": ("Joint curves", "関節の軌跡"),
    "why_near": ("Why it is near", "近さの内訳"),
    "joint": ("Joint", "関節"),
    "meters": ("m, over frames", "m・フレーム"),
    "caption": ("{joint} — {title} [{first}–{last}]", "{joint} — {title} [{first}–{last}]"),
    "no_joint": (
        "{joint} is missing in this recording.",
        "この動作データに {joint} はありません。",
    ),
    "along": ("Distance along the clip (statures)", "区間に沿った距離（身長比）"),
    "by_joint": ("Mean distance by joint (statures)", "関節ごとの平均距離（身長比）"),
}


def texts_of(language: str) -> Mapping[str, str]:
    """Return the words of a language, by name."""
    number = LANGUAGES.index(language) if language in LANGUAGES else 0
    return {name: both[number] for name, both in _TEXTS.items()}


def choose_language(asked: str | None, kept: str | None, accepted: str) -> str:
    """Return the language of a page: as asked in the address, kept in a cookie, or of the browser.

    Parameters
    ----------
    accepted
        The header Accept-Language.
    """
    for wish in (asked, kept):
        if wish in LANGUAGES:
            return str(wish)
    for each in accepted.split(","):
        code = each.split(";")[0].strip().lower()[:2]
        if code in LANGUAGES:
            return code
    return LANGUAGES[0]
