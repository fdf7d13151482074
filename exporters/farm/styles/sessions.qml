<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<!-- Dashed outline of each session. -->
<qgis version="3.34.0" styleCategories="Symbology|MapTips|Temporal" labelsEnabled="0">
 <temporal enabled="1" mode="1" startField="start" endField="" startExpression="" endExpression="" durationField="" durationUnit="ms" fixedDuration="0" limitMode="0" accumulate="1">
  <fixedRange>
   <start></start>
   <end></end>
  </fixedRange>
 </temporal>
 <renderer-v2 type="singleSymbol" enableorderby="0" forceraster="0" symbollevels="0" referencescale="-1">
  <symbols>
   <symbol type="fill" name="0" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleFill" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="color" type="QString" value="0,0,0,0"/>
      <Option name="style" type="QString" value="no"/>
      <Option name="outline_color" type="QString" value="90,90,90,255"/>
      <Option name="outline_style" type="QString" value="dash"/>
      <Option name="outline_width" type="QString" value="0.3"/>
      <Option name="outline_width_unit" type="QString" value="MM"/>
     </Option>
    </layer>
   </symbol>
  </symbols>
 </renderer-v2>
 <mapTip enabled="1">&lt;b&gt;[% "name" %]&lt;/b&gt;, [% format_date("date", 'yyyy-MM-dd') %]&lt;br&gt;[% coalesce(coalesce("implement" || ': ', '') || format_number("worked_area_m2", 0) || ' m² worked in ' || "passes" || ' passes, ' || coalesce(format_number("overlap_area_m2", 0), '?') || ' m² twice, ' || coalesce(format_number("missed_area_m2", 0), '?') || ' m² missed&lt;br&gt;' || coalesce(format_number("work_rate_ha_h", 2) || ' ha/h&lt;br&gt;', ''), '') %][% "folder" %]</mapTip>
</qgis>
